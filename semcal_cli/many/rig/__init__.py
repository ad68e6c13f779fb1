"""Rigs of several cameras and LiDARs: calibration of all cameras, and the transforms between all sensors."""
