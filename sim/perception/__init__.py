"""Where bodies seem to be, and acting on it."""
