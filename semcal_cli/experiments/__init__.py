"""Experiments that compare semcal with other methods: a table, CSV, JSON and a plot."""
