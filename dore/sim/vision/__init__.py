"""The RGB-D camera, and the scene estimated from its pictures."""
