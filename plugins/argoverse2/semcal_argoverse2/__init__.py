"""Argoverse 2 Sensor for semcal."""
