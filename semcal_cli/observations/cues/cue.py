"""A cue: what points and pixels are compared by."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from semcal_cli.config import StartsConfig
from semcal_cli.drive.document import Drive, Frame
from semcal_cli.errors import counted, describe, listed
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.observations import NO_CLASS, FrameObservation, Observations

Observe: TypeAlias = Callable[[Drive, SweepCache | None, bool], Observations]


@dataclass(frozen=True, kw_only=True)
class Cue:
    """A way to give points and pixels classes whose mutual information depends on the pose."""

    observe: Callable[[Drive, SweepCache | None, bool], Observations]
    """Loads every frame of a drive with the classes of the cue, or, if the last argument is true, with its unprocessed
    data. Raises InputError or CalibrationError."""
    files: tuple[str, ...]
    """Keys of a frame's files that are read, in addition to its cloud and that cloud's labels."""
    config: Any = None
    """Settings of the cue, a dataclass that results record; None if there are none."""
    starts: StartsConfig | None = None
    """Starts from which a pose is refined, if the information has many maxima; None if one start is enough."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the cue, as results record them."""
        return {} if self.config is None else asdict(self.config)


def checked(cue: Cue, guarded: Callable[[Observe], Observe]) -> Cue:
    """Check a cue whose types no type checker has seen; what it observes is checked when it does.

    Args:
        cue: The cue of a plugin.
        guarded: Wraps its function.

    Raises:
        TypeError: a field is of another type.
        ValueError: frames have no such files.
    """
    if not isinstance(cue.files, tuple) or not set(cue.files) <= Frame.model_fields.keys():
        raise ValueError(f"files: found {cue.files!r}, needed a tuple of: {', '.join(Frame.model_fields)}")
    if not isinstance(cue.starts, StartsConfig | None):
        raise TypeError(f"starts: found {describe(cue.starts)}, needed a StartsConfig or None")
    try:
        json.dumps(cue.settings)
    except TypeError as error:
        raise TypeError(f"config: {error}; needed a dataclass of numbers and text") from None

    def observe(drive: Drive, sweeps: SweepCache | None, is_raw: bool) -> Observations:
        found = cue.observe(drive, sweeps, is_raw)
        _check(found, drive)
        return found

    return replace(cue, observe=guarded(observe))


def _check(found: Observations, drive: Drive) -> None:
    """Check observations, whose counts would otherwise fail far from here, or not at all."""
    if not isinstance(found, Observations):
        raise TypeError(f"observe: found {describe(found)}, needed Observations")
    if len(found.frame_observations) != len(drive.frames) or found.num_cues != 1:
        raise ValueError(
            f"observe: found {counted(len(found.frame_observations), 'frame')}, needed {len(drive.frames)}, by one cue"
        )
    for side in ("point_class_names", "image_class_names"):
        names = getattr(found, side)
        if not 0 < len(names) <= NO_CLASS or not all(isinstance(name, str) for name in names):
            raise ValueError(f"{side}: found {listed(names)}, needed 1 to {NO_CLASS} names")
    for index, frame in enumerate(found.frame_observations):
        _check_frame(f"frame {index}", frame, (drive.camera.height, drive.camera.width))


def _check_frame(where: str, frame: FrameObservation, size: tuple[int, int]) -> None:
    count = len(frame.cloud.points)
    for name, found, dtype, shape in (
        ("points", frame.cloud.points, np.float32, (count, 3)),
        ("classes of points", frame.cloud.classes, np.uint8, (count,)),
        ("classes of pixels", frame.image.classes, np.uint8, size),
    ):
        if found.dtype != dtype or found.shape != shape:
            needed = f"{np.dtype(dtype)} of shape {shape}"
            raise ValueError(f"{where}: {name}: found {found.dtype} of shape {found.shape}, needed {needed}")
