"""What points and pixels say: their classes, by each cue."""
