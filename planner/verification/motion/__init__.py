"""Checks of how the joints and the tip move: limits at exact extrema, states, poses, lines."""
