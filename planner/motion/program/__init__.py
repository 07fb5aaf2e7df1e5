"""The motion program: its phases, unknowns, constraints and derivatives."""
