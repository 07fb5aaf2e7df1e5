"""Where an arm that follows late may be along a plan, and what it is clear of there."""
