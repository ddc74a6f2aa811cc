"""What the RGB-D camera makes of the table."""
