"""Topics of the simulated Baxter: what it tells, and what it is told."""
