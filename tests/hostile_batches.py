"""Hostile batches: results folders, records, lists, and options after --."""

from hostile_commands import Hostile

BATCHES: dict[str, Hostile] = {}
