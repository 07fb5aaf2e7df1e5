"""The world: bodies, fingers, contacts, falling."""
