"""Image labels and point labels from ONNX networks.

`hub` finds a network by name. `card` describes its input and output, as the user states them or as `sidecars` reads
them from the files beside it. `onnx_network` runs it, and `model` combines what the file and the card say. `views`
makes the images that a network sees. `image_labeller`, `sweep_labeller` and `cloud_labeller` map its output back to
pixels and points, and `labelled_drive` writes a labelled drive.
"""
