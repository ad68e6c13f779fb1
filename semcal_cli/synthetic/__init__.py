"""Synthetic drives with a known answer."""
