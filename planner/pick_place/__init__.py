"""From a pick and a place to a checked plan."""
