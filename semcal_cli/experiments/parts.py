"""Parts of the experiment on trust; the command names them before it loads what measures them."""

PARTS = ("good", "bad", "spoiled", "subtle", "verify")
"""MINE belongs to the good drives."""
