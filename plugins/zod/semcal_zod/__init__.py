"""The Zenseact Open Dataset for semcal."""
