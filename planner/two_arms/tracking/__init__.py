"""Tracking proofs of plans of both arms."""
