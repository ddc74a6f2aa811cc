"""Planners: one class, one YAML file, one test each. `base` holds what they share."""
