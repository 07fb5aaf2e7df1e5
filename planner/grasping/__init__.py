"""Hands, what they hold, and how their fingers travel."""
