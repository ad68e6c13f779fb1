"""A format, a cue and a data set that semcal finds by the entry points of this package."""
