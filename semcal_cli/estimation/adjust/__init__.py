"""Estimates of intrinsics, clocks and priors together with the pose."""
