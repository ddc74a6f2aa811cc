"""Executions: open and closed loop, what is recorded, films."""
