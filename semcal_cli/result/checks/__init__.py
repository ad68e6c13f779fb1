"""The table of checks: what speaks against a pose, how it is measured, its limits, and what to do about it."""
