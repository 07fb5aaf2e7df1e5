"""Handovers: a body goes from one hand to the other in the air."""
