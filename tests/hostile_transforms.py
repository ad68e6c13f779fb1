"""Hostile transforms: files that `convert` and the other commands read a pose from, or write one into."""

from hostile_commands import Hostile

TRANSFORMS: dict[str, Hostile] = {}
