"""MAN TruckScenes for semcal."""
