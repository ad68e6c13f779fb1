"""The calibration, which is the result file of semcal."""
