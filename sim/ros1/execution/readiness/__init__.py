"""Whether a plan may be executed on a robot as it stands, and what would be sent."""
