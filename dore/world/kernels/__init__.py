"""The rules, the exact search, replay and the corridor costs, compiled by numba. `tables` leads in from a reach."""
