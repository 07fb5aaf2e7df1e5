"""The simulated Baxter: `python -m sim.ros1.robot`, or `RosRobot` in Python."""
