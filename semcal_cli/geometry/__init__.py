"""Rigid transforms, and the differences between two of them."""
