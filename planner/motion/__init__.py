"""Motions as nonlinear programs: all phases at once, as fast as the limits and lines allow."""
