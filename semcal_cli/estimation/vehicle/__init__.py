"""Where a LiDAR is on its vehicle: over the ground, and against the direction of travel."""
