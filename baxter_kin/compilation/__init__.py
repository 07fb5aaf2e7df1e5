"""CasADi functions as machine code: from the user's cache, or compiled, tried and kept there."""
