"""The cues: what points and pixels are compared by."""
