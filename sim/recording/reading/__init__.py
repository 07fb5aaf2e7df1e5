"""Recordings read from files, also those of real robots."""
