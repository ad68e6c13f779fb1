"""Experiments on synthetic drives, each one command: a table, CSV, JSON and a plot."""
