"""Batches of drives: processes that may crash or hang run them, and a record keeps the outcome of each."""
