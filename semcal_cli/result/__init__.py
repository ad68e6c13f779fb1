"""The calibration, the result file of semcal."""
