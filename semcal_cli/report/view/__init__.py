"""A drive that is moved by hand: a page on this machine alone, with the points on an image as the pose changes."""
