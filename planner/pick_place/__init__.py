"""Plans of picks and places, from the task to a checked plan."""
