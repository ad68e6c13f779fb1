"""The calibration: what semcal writes."""
