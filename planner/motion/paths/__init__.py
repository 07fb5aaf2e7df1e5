"""Paths of the tip: their pieces, and time-optimal motion along them."""
