"""A local page on which the pose of a drive is moved by hand, with the points on the image."""
