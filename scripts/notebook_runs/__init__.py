"""What storing, trying and testing the notebooks have in common."""
