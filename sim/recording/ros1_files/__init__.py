"""Recordings as files of ROS 1 messages."""
