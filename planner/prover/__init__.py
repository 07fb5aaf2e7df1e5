"""Finds the rows of certificates. Nothing of it is trusted; `planner.certificate` decides."""
