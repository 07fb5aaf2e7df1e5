"""An independent check of plans at 1 kHz: own kinematics, the original meshes, distances by FCL.

Of the toolkit only data is read: knots of trajectories, gripper actions, bodies, joints. Its
kinematics, distances, contacts and proofs are not called here; `problems` alone calls the planner,
for something to check.
"""
