"""The formats of recordings in files: MCAP, the RSDK's CSV, bags of ROS 1, and earlier ones."""
