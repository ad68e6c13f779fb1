"""What a check says."""
