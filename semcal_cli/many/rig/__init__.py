"""Rigs of several cameras and one LiDAR: calibration of all cameras, and the transforms between them."""
