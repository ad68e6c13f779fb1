"""Labels of pictures and sweeps from networks that come as ONNX files.

`card` is what a user states of a network, `network` runs it, `model` joins what both say.
`views` are the pictures that a network sees, `pictures` and `sweeps` carry its answer back to pixels and points, and
`drives` writes a drive with its labels.
"""
