"""Questions to a map: where to put the table, which arm, and how near an arm comes to a pose."""
