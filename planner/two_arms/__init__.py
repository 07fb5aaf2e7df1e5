"""Both arms at once: plans on a common clock, and the proof that the arms keep clear."""
