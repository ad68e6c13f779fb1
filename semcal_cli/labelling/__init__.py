"""Labels of images and sweeps from networks that come as ONNX files.

`hub` finds a network by its name. `card` is what a user states of it, or `sidecars` read from the files that came with
it; `network` runs it, and `model` joins what both say.
`views` are the images that a network sees, `images` and `sweeps` carry its answer back to pixels and points, and
`drives` writes a drive with its labels.
"""
