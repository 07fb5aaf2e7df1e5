"""What a map of one robot says of another that is calibrated a little differently."""
