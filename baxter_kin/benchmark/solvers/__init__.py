"""Other IK solvers, one module each, which is the only place that imports them."""
