"""Inverse kinematics by search: the compiled functions, requests in batches, IPOPT as reference."""
