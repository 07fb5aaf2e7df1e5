"""What the pages tell beside the picture: joints against limits, clearance, and waypoints."""
