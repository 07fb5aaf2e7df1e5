"""Continuous collision checking: that a motion is clear at every instant, not only at samples."""
