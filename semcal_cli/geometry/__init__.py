"""Rigid transforms, and how far two of them are apart."""
