"""Several cameras of one LiDAR: calibrated in one run, and what that tells of one camera beside another."""
