"""What is measured: the robot's shapes and the scene's, and which pairs of them count."""
