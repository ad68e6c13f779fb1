"""Other calibration methods, for comparison."""
