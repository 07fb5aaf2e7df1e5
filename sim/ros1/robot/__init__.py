"""The simulated Baxter: `python -m sim.ros1.robot`, or `sim.ros1.RosRobot` in Python."""
