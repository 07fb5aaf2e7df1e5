"""The live view: the robot and its surroundings in the browser, while the program runs."""
