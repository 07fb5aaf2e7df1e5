"""What a lab asks of a map: where to put the table, which arm, and how far a pose is from reach."""
