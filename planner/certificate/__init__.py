"""An independent checker of plans that carry a certificate: NumPy and the standard library alone.

It derives everything from three files: the plan, the robot's URDF, and the clusters of the robot's
body. It shares no code with the planner, and rounds all arithmetic that a conclusion rests on
outwards.
"""
