"""Assessment of a pose: its uncertainty, and findings against it."""
