"""The parts of the small master: who is there, parameters, and telling nodes what changed."""
