"""What `scripts/fuzz.py` calls, and with which values."""
