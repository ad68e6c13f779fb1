"""Experiments on synthetic drives, each one command: a table, CSV and JSON, and a plot where methods are compared."""
