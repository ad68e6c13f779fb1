"""The initial calibration, without an initial guess (Alg. 2)."""
