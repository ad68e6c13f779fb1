"""Image labels and point labels from ONNX networks.

`hub` finds a network by name. `card` describes its input and output, as the user states them or as `sidecars` reads
them from the files beside it. `network` runs it, and `model` combines what the file and the card say. `views` makes the
images that a network sees, `images` and `sweeps` map its output back to pixels and points, and `drives` writes a
labelled drive.
"""
