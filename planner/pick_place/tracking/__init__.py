"""Tracking: that a plan stays clear on an arm that follows its set-points as real ones do."""
