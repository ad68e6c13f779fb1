"""The ONCE data set for semcal."""
