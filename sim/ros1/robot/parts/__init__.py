"""Parts of the simulated Baxter, each a state machine that knows no wire."""
