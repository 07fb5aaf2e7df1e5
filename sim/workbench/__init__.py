"""A robot at a table with blocks on it, for tasks of one line."""
