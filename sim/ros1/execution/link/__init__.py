"""What a Baxter reports to its clients, and what they send it."""
