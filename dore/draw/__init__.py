"""Pictures of boards and curves."""
