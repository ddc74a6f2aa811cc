"""The two DQN structures: `single` (one network, two heads) and `sequential` (pick, lift, place)."""
