"""Motions of a body that both hands hold, and whole tasks with it."""
