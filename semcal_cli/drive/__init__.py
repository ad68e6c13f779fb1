"""The drive: the input of a calibration."""
