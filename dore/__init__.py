"""dore learns which obstacle to move, and where to, so that an arm can reach a target in clutter."""

__version__ = "0.1.0"
