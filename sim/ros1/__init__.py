"""Baxter's ROS 1 interface: a node, a small master, a simulated Baxter, and driving a Baxter."""
