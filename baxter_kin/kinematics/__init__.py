"""Kinematics of an arm: by Pinocchio, as Denavit-Hartenberg parameters, as CasADi expressions."""
