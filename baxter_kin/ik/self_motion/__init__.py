"""The self-motion of a pose: its curves, their pieces inside the limits, the best point on them."""
