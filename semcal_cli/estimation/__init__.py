"""Estimates of the pose."""
