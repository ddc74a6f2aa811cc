"""The commands: they build what the config names, and run it."""
