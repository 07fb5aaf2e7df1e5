"""Builds of a small map that are killed at random, for `scripts/atlas_campaign.py`."""
