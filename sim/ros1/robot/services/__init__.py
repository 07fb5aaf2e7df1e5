"""Services of the simulated Baxter: inverse kinematics, and models that come and go."""
