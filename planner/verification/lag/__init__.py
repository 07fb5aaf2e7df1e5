"""Checks of plans on arms that lag behind their set-points."""
