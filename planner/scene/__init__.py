"""Bodies and their shapes, what touches what, and what stands on what."""
