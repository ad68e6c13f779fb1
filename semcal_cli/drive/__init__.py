"""The drive: what a calibration reads."""
