"""A network from an ONNX file, run by onnxruntime and by nothing else."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.errors import InputError, check_installed, mismatch
from semcal_cli.files.reading import open_file

if TYPE_CHECKING:
    import onnxruntime

NUMPY_NAMES = {"float": "float32", "double": "float64"}
"""NumPy's names of ONNX's types, where they differ."""
PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
"""Providers by the names of the devices."""
SILENT = 4
"""Severity from which onnxruntime writes to stderr: never, since its errors are raised, too."""


@dataclass(frozen=True)
class Port:
    """An input or an output of a network."""

    name: str
    """Name in the model."""
    shape: tuple[int | None, ...]
    """Sizes of the axes; None for one that takes any."""
    dtype: str
    """NumPy's name of the type."""

    def __str__(self) -> str:
        sizes = " x ".join("any" if size is None else str(size) for size in self.shape)
        return f"{self.name!r} {sizes or 'scalar'} {self.dtype}"


@dataclass(frozen=True, eq=False)
class Network:
    """An open network."""

    path: Path
    """File of the model."""
    session: onnxruntime.InferenceSession
    """Session that runs it; several threads may."""
    inputs: tuple[Port, ...]
    """Its inputs, in order."""
    outputs: tuple[Port, ...]
    """Its outputs, in order."""

    @property
    def input(self) -> Port:
        """The first input that may be an image or a range image, or else the first of all."""
        return next((port for port in self.inputs if len(port.shape) == 4), self.inputs[0])

    @property
    def points(self) -> Port:
        """The input named `points`, or else the first one."""
        return next((port for port in self.inputs if port.name == "points"), self.inputs[0])

    def others(self, *known: str) -> list[str]:
        """Names of the inputs beside `input` and those that are known."""
        return [port.name for port in self.inputs if port.name not in (self.input.name, *known)]

    def unfit(self, found: object, needed: object) -> InputError:
        """Make the error of a network that is not one that is needed."""
        return InputError(f"{self.path}: {mismatch(found, needed)}")

    def as_ids(self, output: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
        """Take an output as ids of classes.

        Raises:
            InputError: a number is no id.
        """
        low, high = output.min(), output.max()
        if low < 0 or high >= _core.NO_ID:
            raise self.unfit(f"ids from {low} to {high}", f"0 to {_core.NO_ID - 1}")
        return np.asarray(output, np.uint16)

    def run(
        self, tensors: Mapping[str, npt.NDArray[Any]], names: Sequence[str]
    ) -> Mapping[str, npt.NDArray[Any]]:
        """Run the network on a tensor for each input, and give the outputs of these names.

        Raises:
            InputError: the network fails, as on a size that it cannot take.
        """
        types = {port.name: port.dtype for port in self.inputs}
        try:
            given = {name: tensor.astype(types[name], copy=False) for name, tensor in tensors.items()}
            found = self.session.run(list(names), given)
        except Exception as error:  # onnxruntime has an exception of its own for each kind of failure.
            shapes = " and ".join(" x ".join(map(str, tensor.shape)) for tensor in tensors.values())
            raise InputError(f"{self.path}: failed on an input of {shapes}: {_reason(error)}") from None
        return dict(zip(names, map(np.asarray, found), strict=True))


def open_network(path: Path, device: str = "cpu", num_threads: int | None = None) -> Network:
    """Open a model; its weights may lie in files beside it, and nowhere else.

    Args:
        path: File of the model, .onnx.
        device: cpu or cuda.
        num_threads: Threads of a run; None for all cores.

    Raises:
        InputError: the file is missing or no model, onnxruntime or the device is missing, or there is no input.
    """
    check_installed(str(path), "onnxruntime", "label")
    import onnxruntime

    with open_file(path):
        pass
    provider = PROVIDERS[device]
    if provider not in onnxruntime.get_available_providers():
        raise InputError(
            f"--device {device}: found an onnxruntime without {provider}, needed one with it, as onnxruntime-gpu"
        )
    options = onnxruntime.SessionOptions()
    options.log_severity_level = SILENT
    # Threads that wait for the next image leave the cores to what is done between images.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    if num_threads is not None:
        options.intra_op_num_threads = num_threads
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:
        raise InputError(f"{path}: found no model that onnxruntime can open: {_reason(error)}") from None
    inputs, outputs = (tuple(map(_port, ports)) for ports in (session.get_inputs(), session.get_outputs()))
    if not inputs:
        raise InputError(f"{path}: found no input, needed one: an image, a range image or points")
    return Network(path, session, inputs, outputs)


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", text)[:300]


def _port(port: Any) -> Port:
    shape = tuple(size if isinstance(size, int) and size > 0 else None for size in port.shape)
    kind = port.type.removeprefix("tensor(").removesuffix(")")
    return Port(port.name, shape, NUMPY_NAMES.get(kind, kind))
