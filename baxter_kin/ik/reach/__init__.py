"""The arm as a linkage: closed-form kinematics, and proofs that a pose is out of reach."""
