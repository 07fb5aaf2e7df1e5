"""An arm's kinematics: by Pinocchio, in Denavit-Hartenberg parameters, as CasADi expressions."""
