"""A cue: what points and pixels are compared by."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np

from semcal_cli.config import StartsConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import counted, describe, listed
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.observations import NO_CLASS, FrameObservation, Observations

Observe: TypeAlias = Callable[[Drive, SweepCache | None, bool], Observations]


@dataclass(frozen=True, kw_only=True)
class Cue:
    """A way to classify points and pixels, so that their mutual information depends on the pose, and its policy.

    Stages and checks never ask for a cue by name: they ask what the cue states here.
    """

    observe: Callable[[Drive, SweepCache | None, bool], Observations]
    """Loads every frame of a drive with the classes of the cue, or, if the last argument is true, with its unprocessed
    data. Raises InputError or CalibrationError."""
    files: tuple[str, ...]
    """Keys of a frame's files that are read, in addition to its cloud and that cloud's labels."""
    config: Any = None
    """Settings of the cue, a dataclass that results record; None if there are none."""
    starts: StartsConfig | None = None
    """Starts from which a pose is refined, if the information has many maxima; None if one start is enough."""
    starts_alone: StartsConfig | None = None
    """Starts if the cue is compared alone, where they differ from those beside other cues. Only these may have a
    contrast, whose classes are those of one cue."""
    can_find_mounting: bool = True
    """Whether mounting directions can be distinguished; otherwise the cue only works near the right pose."""
    finds_mounting_alone: bool = False
    """Whether mountings are searched for by this cue alone beside one that is coarse or cannot find them. If such a cue
    needs no several starts, its maximum is the right one, and it refines the pose from afar."""
    is_coarse: bool = False
    """Whether the cue only brings a pose near: beside one that cannot find mountings, it does not refine the pose, but
    has to agree with it in the end."""
    weight_beside_local: float = 1.0
    """Weight of each point when a pose is refined together with a local cue."""
    is_weak: bool = False
    """Whether the best pose by this cue alone is often wrong, so that it is the first doubt where others speak against
    the pose."""
    min_scenes: int = 1
    """Minimum number of scenes from which a pose is trusted."""
    has_point_labels: bool = False
    """Whether the classes of points are labels, which may have been copied from the pixels."""
    has_image_labels: bool = False
    """Whether the classes of pixels are labels, whose borders may be off, and which may belong to other pixels."""
    has_partitions: bool = False
    """Whether clouds have partitions. The information is then adjusted for chance and has no unit."""
    has_vectors: bool = False
    """Whether points and pixels have feature vectors, which need the estimator MINE."""

    @property
    def is_multimodal(self) -> bool:
        """Whether the information has many maxima near the right one, so that a pose is refined from several starts."""
        return self.starts is not None

    @property
    def is_local(self) -> bool:
        """Whether the cue shows only small offsets of the pose."""
        return self.is_multimodal and not self.has_partitions

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
        raise ValueError(f"files: found {cue.files!r}, expected a tuple of: {', '.join(Frame.model_fields)}")
    _check_policy(cue)
    try:
        json.dumps(cue.settings)
    except TypeError as error:
        raise TypeError(f"config: {error}; expected a dataclass of numbers and text") from None

    def observe(drive: Drive, sweeps: SweepCache | None, is_raw: bool) -> Observations:
        observations = cue.observe(drive, sweeps, is_raw)
        _check(observations, drive)
        if not is_raw:
            _check_stated(cue, observations)
        return observations

    return replace(cue, observe=guarded(observe))


def _check_policy(cue: Cue) -> None:
    """Check what a cue states of itself: the types of its fields, and that they do not contradict one another."""
    for name in ("starts", "starts_alone"):
        if not isinstance(starts := getattr(cue, name), StartsConfig | None):
            raise TypeError(f"{name}: found {describe(starts)}, expected a StartsConfig or None")
    if cue.starts_alone is not None and cue.starts is None:
        raise ValueError("starts: found None beside starts_alone, expected a StartsConfig")
    if cue.starts is not None and cue.starts.contrast is not None:
        raise ValueError("starts: found a contrast, expected none: it is for starts_alone")
    if cue.has_partitions and cue.starts_alone is not None and cue.starts_alone.contrast is not None:
        raise ValueError("starts_alone: found a contrast beside has_partitions=True, expected none")
    for name in (field.name for field in fields(cue) if isinstance(field.default, bool)):
        if not isinstance(value := getattr(cue, name), bool):
            raise TypeError(f"{name}: found {describe(value)}, expected True or False")
    weight, scenes = cue.weight_beside_local, cue.min_scenes
    if isinstance(weight, bool) or not isinstance(weight, int | float) or not 0.0 < weight <= 1.0:
        raise ValueError(
            f"weight_beside_local: found {describe(weight)}, expected a number above 0 and up to 1"
        )
    if isinstance(scenes, bool) or not isinstance(scenes, int) or scenes < 1:
        raise ValueError(f"min_scenes: found {describe(scenes)}, expected a whole number of at least 1")
    for name in ("finds_mounting_alone", "is_coarse"):
        if getattr(cue, name) and not cue.can_find_mounting:
            raise ValueError(f"can_find_mounting: found False beside {name}=True, expected True")


def _check_stated(cue: Cue, observations: Observations) -> None:
    """Check that a cue observes what it states."""
    for name in ("has_partitions", "has_vectors"):
        if (observed := getattr(observations, name)) != (stated := getattr(cue, name)):
            raise ValueError(
                f"{name}: found {observed} in what it observes, expected {stated}, as the cue states"
            )
    if cue.starts_alone is not None and (contrast := cue.starts_alone.contrast) is not None:
        others = observations.point_class_names[1:]
        if contrast.class_weights.keys().isdisjoint(others):
            found = listed([*contrast.class_weights])
            raise ValueError(
                f"starts_alone.contrast: found weights of {found}, expected any of {listed(others)}"
            )
        if any(cloud.plain_class != 0 for cloud in observations.clouds):
            raise ValueError(
                "plain_class: needed 0, the class that starts_alone.contrast compares others with"
            )


def _check(observations: Observations, drive: Drive) -> None:
    """Check observations, whose counts would otherwise fail far from here, or not at all."""
    if not isinstance(observations, Observations):
        raise TypeError(f"observe: found {describe(observations)}, expected Observations")
    num_frames = len(observations.frame_observations)
    if num_frames != len(drive.frames) or observations.num_cues != 1:
        raise ValueError(
            f"observe: found {counted(num_frames, 'frame')}, needed {len(drive.frames)}, by one cue"
        )
    for side in ("point_class_names", "image_class_names"):
        names = getattr(observations, side)
        if not 0 < len(names) <= NO_CLASS or not all(isinstance(name, str) for name in names):
            raise ValueError(f"{side}: found {listed(names)}, needed 1 to {NO_CLASS} names")
    for index, frame in enumerate(observations.frame_observations):
        _check_frame(f"frame {index}", frame, (drive.camera.height, drive.camera.width))


def _check_frame(where: str, frame: FrameObservation, size: tuple[int, int]) -> None:
    count = len(frame.cloud.points)
    for name, array, dtype, shape in (
        ("points", frame.cloud.points, np.float32, (count, 3)),
        ("classes of points", frame.cloud.classes, np.uint8, (count,)),
        ("classes of pixels", frame.image.classes, np.uint8, size),
    ):
        if array.dtype != dtype or array.shape != shape:
            needed = f"{np.dtype(dtype)} of shape {shape}"
            raise ValueError(
                f"{where}: {name}: found {array.dtype} of shape {array.shape}, expected {needed}"
            )
