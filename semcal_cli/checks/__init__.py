"""Checks of a pose, and of a drive before a calibration: one file a check or a family of checks."""
