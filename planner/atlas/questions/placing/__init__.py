"""Places of a table, or of the robot, at which a task can be done."""
