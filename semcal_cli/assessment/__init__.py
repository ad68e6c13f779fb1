"""How sure a pose is, and what speaks against it."""
