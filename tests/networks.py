"""Small ONNX networks whose answers NumPy knows, and cards of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import yaml
from onnx import TensorProto, helper, numpy_helper

OPSET = 17
IR_VERSION = 9
COLORS = np.array(
    [[40, 40, 40], [220, 60, 60], [60, 220, 60], [60, 60, 220], [220, 220, 60], [200, 200, 200]], np.uint8
)
"""Red, green, blue of classes that differ in colour alone."""
STREET_COLORS = np.array([[160, 190, 225], [90, 90, 92], [60, 110, 50], [150, 110, 90]], np.uint8)
"""The same of sky, road, green and brown on synthetic streets."""
TYPES = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16, "uint8": TensorProto.UINT8}
NAMES = ["a", "b", "c", "d", "e", "f"]
POINT_CARD = {
    "semcal_point_model": 1,
    "rows": 16,
    "columns": 128,
    "elevation_deg": [-25.0, 3.0],
    "channels": ["range", "x", "y", "z", "intensity"],
    "mean": [12.12, 10.88, 0.23, -1.04, 0.21],
    "std": [12.32, 11.47, 6.91, 0.86, 0.16],
    "classes": {"near": [1], "far": [2]},
    "neighbors": None,
}
"""A card of `range_network`."""


def card(folder: Path, **values: object) -> None:
    """Write the card of `color_network`, net.yaml; a value of None leaves a key out."""
    document = {"semcal_image_model": 1, "color": "rgb", "scale": 1 / 255, "classes": NAMES} | values
    text = yaml.safe_dump({key: value for key, value in document.items() if value is not None})
    (folder / "net.yaml").write_text(text)


def save(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    inputs: dict[str, tuple[int, Sequence[Any]]],
    outputs: dict[str, tuple[int, Sequence[Any]]],
    constants: dict[str, np.ndarray] | None = None,
) -> Path:
    """Write a model; inputs and outputs are types and shapes by name."""
    graph = helper.make_graph(
        list(nodes),
        "net",
        [helper.make_tensor_value_info(name, kind, list(shape)) for name, (kind, shape) in inputs.items()],
        [helper.make_tensor_value_info(name, kind, list(shape)) for name, (kind, shape) in outputs.items()],
        [numpy_helper.from_array(array, name) for name, array in (constants or {}).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version = IR_VERSION
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def color_network(
    path: Path,
    size: tuple[Any, Any] = ("h", "w"),
    *,
    kind: str = "logits",
    stride: int = 1,
    channels_last: bool = False,
    dtype: str = "float32",
    scale: float = 255.0,
    colors: np.ndarray = COLORS,
) -> Path:
    """Write a network that knows classes by colour: the score of a class is 2 c.x - c.c, highest for the nearest.

    Args:
        path: File to write.
        size: Rows and columns; texts for any.
        kind: logits, probabilities or ids.
        stride: Pixels a cell of the output: of each square, the mean colour is taken.
        channels_last: Whether the channels of input and output are the last axis.
        dtype: Type of the input.
        scale: What the input is multiplied with, to be colours from 0 to 255.
        colors: (C, 3) red, green, blue of the classes.
    """
    weights = colors.astype(np.float32) * 2.0 * np.float32(1e-4) * np.float32(scale)
    bias = -(colors.astype(np.float32) ** 2).sum(1) * np.float32(1e-4)
    steps: list[tuple[str, list[str], dict[str, Any]]] = [("Conv", ["w", "b"], {})]
    if stride > 1:
        steps.insert(0, ("AveragePool", [], {"kernel_shape": [stride] * 2, "strides": [stride] * 2}))
    if channels_last:
        steps.insert(0, ("Transpose", [], {"perm": [0, 3, 1, 2]}))
    if dtype != "float32":
        steps.insert(0, ("Cast", [], {"to": TensorProto.FLOAT}))
    if kind == "probabilities":
        steps.append(("Softmax", [], {"axis": 1}))
    if kind == "ids":
        steps.append(("ArgMax", [], {"axis": 1, "keepdims": 0}))
    elif channels_last:
        steps.append(("Transpose", [], {"perm": [0, 2, 3, 1]}))
    names = ["x", *(f"after {step[0]} {index}" for index, step in enumerate(steps[1:])), "y"]
    nodes = [
        helper.make_node(operator, [before, *constants], [after], **attributes)
        for (operator, constants, attributes), before, after in zip(steps, names, names[1:], strict=False)
    ]
    out = [side // stride if isinstance(side, int) else f"{side}o" for side in size]
    number = len(colors)
    shape_in = (1, *size, 3) if channels_last else (1, 3, *size)
    shape_out = (1, *out) if kind == "ids" else ((1, *out, number) if channels_last else (1, number, *out))
    constants = {"w": weights.reshape(number, 3, 1, 1), "b": bias}
    kind_out = TensorProto.INT64 if kind == "ids" else TensorProto.FLOAT
    return save(path, nodes, {"x": (TYPES[dtype], shape_in)}, {"y": (kind_out, shape_out)}, constants)


def street_network(folder: Path) -> Path:
    """A network that tells sky, road and the rest by colour: enough to see that the way is right."""
    card(folder, classes=["sky", "road", "green", "brown"])
    return color_network(folder / "net.onnx", stride=2, colors=STREET_COLORS)


def range_network(path: Path, channels: int, rows: int, columns: int, place: int, limit: float) -> Path:
    """Write a network for range images: class 1 where a channel is at most `limit`, and 2 above; 0 never."""
    weights = np.zeros((3, channels, 1, 1), np.float32)
    weights[2, place] = 1.0
    bias = np.array([-1e3, 0.0, -limit], np.float32)
    nodes = [helper.make_node("Conv", ["x", "w", "b"], ["y"])]
    inputs = {"x": (TensorProto.FLOAT, (1, channels, rows, columns))}
    outputs = {"y": (TensorProto.FLOAT, (1, 3, rows, columns))}
    return save(path, nodes, inputs, outputs, {"w": weights, "b": bias})


def constant_network(values: np.ndarray) -> Callable[[Path], None]:
    """A network that gives these values, whatever it sees."""
    if values.dtype == np.float64:
        values = values.astype(np.float32)

    def make(folder: Path) -> None:
        nodes = [helper.make_node("Identity", ["k"], ["y"])]
        kind = helper.np_dtype_to_tensor_dtype(values.dtype)
        inputs = {"x": (TensorProto.FLOAT, [1, 3, "h", "w"])}
        save(folder / "net.onnx", nodes, inputs, {"y": (kind, values.shape)}, {"k": values})

    return make
