"""Stamps of recordings are whole nanoseconds."""

NS = 1_000_000_000
"""Number of nanoseconds of a second."""
