"""Hostile sizes: files that are or claim to be too large, and files whose opening would never end."""

from hostile_commands import Hostile

SIZES: dict[str, Hostile] = {}
