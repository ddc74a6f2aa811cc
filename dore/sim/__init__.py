"""The simulated arm: the only packages that import mani_skill or sapien. Import a module of it by name."""
