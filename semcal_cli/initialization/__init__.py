"""The initial calibration, from nothing (Alg. 2)."""
