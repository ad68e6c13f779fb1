"""The initial calibration, without a start guess (Alg. 2)."""
