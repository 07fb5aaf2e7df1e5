"""What `scripts/set_up.py` is made of: Python's own library alone, from Python 3.7 on."""
