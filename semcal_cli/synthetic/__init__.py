"""Synthetic drives, whose true transform is known."""
