"""How well the data determine a pose."""
