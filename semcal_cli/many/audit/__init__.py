"""The audit of a data set: whether its delivered calibrations hold, camera by camera, and since when not."""
