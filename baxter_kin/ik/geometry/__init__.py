"""Inverse kinematics by geometry: closed forms, bounds on the reach, proofs of what lies beyond."""
