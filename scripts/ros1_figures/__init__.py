"""What `scripts/measure_ros1.py` measures."""
