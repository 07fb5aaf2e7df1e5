"""Bodies and their shapes, contacts between them, and the supports that they stand on."""
