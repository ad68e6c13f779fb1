"""An ONNX network, run by onnxruntime and nothing else."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.errors import InputError, check_installed, mismatch, reason
from semcal_cli.files.input_files import open_file

if TYPE_CHECKING:
    import onnxruntime

NUMPY_NAMES = {"float": "float32", "double": "float64"}
"""NumPy names of ONNX types, where the two differ."""
PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
"""Execution providers by device."""
SILENT = 4
"""Log level at which onnxruntime writes nothing to stderr; its errors are raised as well."""


@dataclass(frozen=True)
class Port:
    """An input or an output of a network."""

    name: str
    """Name in the model."""
    shape: tuple[int | None, ...]
    """Sizes of the axes; None for an axis of any size."""
    dtype: str
    """NumPy name of the type."""

    def __str__(self) -> str:
        sizes = " x ".join("any" if size is None else str(size) for size in self.shape)
        return f"{self.name!r} {sizes or 'scalar'} {self.dtype}"


@dataclass(frozen=True, eq=False)
class Network:
    """An open network."""

    path: Path
    """File of the model."""
    session: onnxruntime.InferenceSession
    """Session that runs it. Threads may share it."""
    inputs: tuple[Port, ...]
    """Inputs, in order."""
    outputs: tuple[Port, ...]
    """Outputs, in order."""

    @property
    def input(self) -> Port:
        """The first input with four axes, as of images and range images, or else the first input."""
        return next((port for port in self.inputs if len(port.shape) == 4), self.inputs[0])

    def other_inputs(self) -> list[str]:
        """List the names of all inputs but `input`."""
        return [port.name for port in self.inputs if port.name != self.input.name]

    def unfit(self, found: object, needed: object) -> InputError:
        """Make the error of a network that does not fit."""
        return InputError(f"{self.path}: {mismatch(found, needed)}")

    def as_ids(self, output: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
        """Read an output as class ids.

        Raises:
            InputError: a number is not an id.
        """
        low, high = output.min(), output.max()
        if low < 0 or high >= core.NO_ID:
            raise self.unfit(f"ids from {low} to {high}", f"0 to {core.NO_ID - 1}")
        return np.asarray(output, np.uint16)

    def run(
        self, tensors: Mapping[str, npt.NDArray[Any]], names: Sequence[str]
    ) -> Mapping[str, npt.NDArray[Any]]:
        """Run the network on one tensor for each input, and return the outputs with these names.

        Raises:
            InputError: the network fails, for example on a size that it does not accept.
        """
        types = {port.name: port.dtype for port in self.inputs}
        try:
            inputs = {name: tensor.astype(types[name], copy=False) for name, tensor in tensors.items()}
            outputs = self.session.run(list(names), inputs)
        except Exception as error:  # onnxruntime has its own exception for each kind of failure.
            shapes = " and ".join(" x ".join(map(str, tensor.shape)) for tensor in tensors.values())
            raise InputError(f"{self.path}: failed on an input of {shapes}: {_reason(error)}") from None
        return dict(zip(names, map(np.asarray, outputs), strict=True))


def open_network(path: Path, device: str = "cpu", num_threads: int | None = None) -> Network:
    """Open a model. Its weights may be in files beside it, and nowhere else.

    Args:
        path: File of the model, .onnx.
        device: cpu or cuda.
        num_threads: Number of threads of a run; None for all cores.

    Raises:
        InputError: the file is missing or is not a model, onnxruntime or the device is missing, or the model has no
            input.
    """
    check_installed(str(path), "onnxruntime", "label")
    import onnxruntime

    with open_file(path):
        pass
    provider = PROVIDERS[device]
    if provider not in onnxruntime.get_available_providers():
        raise InputError(
            f"--device {device}: found an onnxruntime without {provider}, expected one with it, such as onnxruntime-gpu"
        )
    options = onnxruntime.SessionOptions()
    options.log_severity_level = SILENT
    # Threads that wait for the next image leave the cores to the work between images.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    if num_threads is not None:
        options.intra_op_num_threads = num_threads
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:
        raise InputError(f"{path}: is not a model that onnxruntime can open: {_reason(error)}") from None
    inputs, outputs = (tuple(map(_port, ports)) for ports in (session.get_inputs(), session.get_outputs()))
    if not inputs:
        raise InputError(f"{path}: found no input, expected an image, a range image or points")
    return Network(path, session, inputs, outputs)


def _reason(error: Exception) -> str:
    return re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", reason(error))[:300]


def _port(port: Any) -> Port:
    shape = tuple(size if isinstance(size, int) and size > 0 else None for size in port.shape)
    kind = port.type.removeprefix("tensor(").removesuffix(")")
    return Port(port.name, shape, NUMPY_NAMES.get(kind, kind))
