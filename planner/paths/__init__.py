"""Ways around obstacles."""
