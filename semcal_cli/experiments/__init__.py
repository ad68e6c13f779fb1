"""Experiments on synthetic drives, one command each: a table, CSV, JSON and, to compare methods, a plot."""
