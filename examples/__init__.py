"""Tasks beyond the demo, each a short program on the public API: `python -m examples.tower`."""
