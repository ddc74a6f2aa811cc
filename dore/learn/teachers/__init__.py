"""Teachers: what a run learns from besides its own rewards. Each is one class and one YAML file (conf/teacher)."""
