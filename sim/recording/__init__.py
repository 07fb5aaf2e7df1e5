"""What happened, as data and files."""
