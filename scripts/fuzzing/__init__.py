"""What `scripts/fuzz.py` calls, with what, and what it counts as a fault."""
