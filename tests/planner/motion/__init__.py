"""Tests of `planner.motion`."""
