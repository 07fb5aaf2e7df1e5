"""The robot's body among others: distances, free configurations, proofs of motions."""
