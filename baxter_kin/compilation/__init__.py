"""Compile CasADi functions and C to machine code, test it, and keep it in the user's cache."""
