"""Learning: the environment, the agents, and Algorithm 2."""
