"""Motions along recorded ones: at their times, or as fast as possible."""
