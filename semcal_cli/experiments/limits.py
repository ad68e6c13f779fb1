"""What the checks measure on good drives and on bad ones, by labels and by segments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from semcal_cli.assessment.stages import Stages
from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import load
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.outcome import distance_in_limits, errors_of
from semcal_cli.experiments.pool import Pool, with_frames
from semcal_cli.experiments.spoiled import KINDS as SPOILED
from semcal_cli.experiments.trust import OTHER_DRIVE
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.search import Initialization
from semcal_cli.pipeline import assess, initialize, refine_and_polish
from semcal_cli.synthetic import spoiling
from semcal_cli.synthetic.raw_drive import Labels, RawDrive, read_raw_drive, write_raw_drive

PAIRS, FEW_PAIRS = (5, 8), (1, 2)
NUM_FRAMES: dict[str, object] = {"num_frames": max(PAIRS) + 1}
"""Change of a rig: frames of each drive, one more than are used."""
NOISES = (0.0, 0.1, 0.2)
DELAY_MS = 40.0
Spoil = Callable[[RawDrive, np.random.Generator], RawDrive]


def _of_another_drive(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Give each cloud the picture of another drive of the rig."""
    return raw.with_frames(
        own.with_picture_of(other) for own, other in zip(raw.frames, raw.unused, strict=True)
    )


def _one_class(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Give all points and pixels of the drive the class of most points, except for one label in a hundred."""
    counts = np.bincount(np.concatenate([frame.point_labels for frame in raw.frames]))
    counts[spoiling.UNLABELLED] = 0

    def mostly_one(ids: Labels) -> Labels:
        return np.where(rng.random(ids.shape) < 0.01, ids, counts.argmax()).astype(np.uint8)

    return raw.with_frames(
        replace(
            frame,
            point_labels=mostly_one(frame.point_labels),
            image_labels=mostly_one(frame.image_labels),
        )
        for frame in raw.frames
    )


def _labelled_from_pictures(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Label points by the pixels that they land on, as a tool does that projects label images into clouds."""
    return spoiling.projected_labels(raw, raw.frames[0].T_camera_lidar)


GOOD, FEW, MOVING = "good", "good, few pairs", "good, moving"
ANOTHER_DRIVE = "pictures of another drive"
ANOTHER_MOMENT = "one picture of another moment"
TURNED = "each cloud turned by its own 0.7 to 1 degrees"
ONE_CLASS = "one class everywhere"
LABELLED_FROM_PICTURES = "labels of points made from the pictures"
POINTS_SHIFTED, PIXELS_SHIFTED = "point labels shifted by 3", "picture labels shifted by 3 to 4 px"
WRONG_K, WRONG_FX = "K wrong by 10 %", "fx alone wrong by 3 %"
LATE = f"pictures {DELAY_MS:g} ms late"
WRONG_POSE = "a wrong pose"
"""Not a kind of drive: a good drive whose calibration ended elsewhere."""
KINDS: dict[str, Spoil] = {
    GOOD: spoiling.as_it_is,
    FEW: spoiling.as_it_is,
    ANOTHER_DRIVE: _of_another_drive,
    WRONG_K: partial(spoiling.zoom_wrong, share=0.1),
    **{name: SPOILED[name].spoil for name in (ANOTHER_MOMENT, TURNED)},
    ONE_CLASS: _one_class,
    LABELLED_FROM_PICTURES: _labelled_from_pictures,
    **{name: SPOILED[name].spoil for name in (POINTS_SHIFTED, PIXELS_SHIFTED, WRONG_FX)},
}
"""Ways to change a good drive."""
BY_SEGMENTS = (GOOD, FEW, ANOTHER_DRIVE, WRONG_K, ANOTHER_MOMENT, TURNED)
OF_CUES: dict[CueName, tuple[str, ...]] = {"labels": (*KINDS, MOVING, LATE), "segments": BY_SEGMENTS}
"""Kinds that are run by each cue."""
MOTIONS = {MOVING: 0.0, LATE: DELAY_MS}
"""Delay of the pictures of drives with a known motion, in milliseconds."""
BAD_OF = {
    "other-mounting": WRONG_POSE,
    "other-azimuth": ANOTHER_DRIVE,
    "other-pose": WRONG_POSE,
    "one-class": ONE_CLASS,
    "wrong-pairing": ANOTHER_DRIVE,
    "odd-frames": ANOTHER_MOMENT,
    "shifted-point-labels": POINTS_SHIFTED,
    "shifted-label-images": PIXELS_SHIFTED,
    "leaked-labels": LABELLED_FROM_PICTURES,
    "frames-disagree": TURNED,
    "focal-length": WRONG_K,
    "intrinsics": WRONG_FX,
    "clocks": LATE,
}
"""What is wrong with the drives that a check is there for, by its topic."""


@dataclass(frozen=True)
class Case:
    """One calibration of a drive."""

    kind: str
    """Key of `KINDS` or of `MOTIONS`."""
    cue: CueName
    seed: int
    num_pairs: int
    noise: float
    """Share of wrong labels on both sides."""


@dataclass(frozen=True)
class Value:
    """What a check measured in one calibration."""

    kind: str
    cue: str
    seed: int
    rig: str
    num_pairs: int
    noise: float
    is_right: bool
    """Whether the pose is right, as `Outcome.is_wrong` has it."""
    topic: str
    """Topic of the check."""
    limit: str
    """Name of its limit."""
    value: float


def cases(seeds: range) -> list[Case]:
    """List the cases, seed by seed."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng((seed, len(KINDS)))
        for cue, kind in ((cue, kind) for cue, kinds in OF_CUES.items() for kind in kinds):
            num_pairs = int(rng.choice(FEW_PAIRS if kind == FEW else PAIRS))
            found.append(Case(kind, cue, seed, num_pairs, float(rng.choice(NOISES))))
    return found


@dataclass(frozen=True)
class Runner:
    """Runs a case; it can be pickled for other processes."""

    pool: Pool
    """Pool of drives with pictures."""

    def __call__(self, case: Case) -> list[Value]:
        """Calibrate a drive, and list what the checks measured; nothing if it cannot be calibrated."""
        rig = list(RIGS)[case.seed % len(RIGS)]
        with TemporaryDirectory() as folder:
            drive, truth = self._drive(case, rig, Path(folder))
            try:
                stages = _calibrate(drive, case.cue)
            except SemcalError:
                return []
        is_right = distance_in_limits(errors_of(stages.T_camera_lidar, truth)) <= 1.0
        about = Value(**vars(case), rig=rig, is_right=is_right, topic="", limit="", value=0.0)
        return [
            replace(about, topic=topic, limit=limit, value=value)
            for topic, limit, value in _values(stages)
            if np.isfinite(value)
        ]

    def _drive(self, case: Case, rig: str, folder: Path) -> tuple[Path | Drive, Pose]:
        """Make the drive of a case, with its true pose (4, 4)."""
        rng = np.random.default_rng((case.seed, case.num_pairs, *case.kind.encode(), *case.cue.encode()))
        if case.kind in MOTIONS:
            changes = RIGS[rig] | NUM_FRAMES | {"motion": "mixed", "delay_ms": MOTIONS[case.kind]}
            drive, truth = self.pool.read(f"{rig}_{case.kind.split()[-1]}", changes, case.seed)
            return with_frames(drive, range(case.num_pairs)), truth
        raw = self._read(rig, case.seed, rng, case.num_pairs + 1)
        other = partial(self._read, rig, case.seed + OTHER_DRIVE, rng, case.num_pairs)
        unused = other().frames if case.kind == ANOTHER_DRIVE else raw.frames[case.num_pairs :]
        raw = replace(raw, frames=raw.frames[: case.num_pairs], unused=unused)
        raw = KINDS[case.kind](spoiling.wrong_labels(raw, rng, case.noise), rng)
        return write_raw_drive(raw, folder), raw.frames[0].T_camera_lidar

    def _read(self, rig: str, seed: int, rng: np.random.Generator, num_frames: int) -> RawDrive:
        """Read a random choice of the frames of a drive."""
        drive, truth = self.pool.read(rig, RIGS[rig] | NUM_FRAMES, seed)
        chosen = rng.choice(len(drive.frames), num_frames, replace=False).tolist()
        return read_raw_drive(with_frames(drive, chosen), truth)


def _calibrate(drive: Path | Drive, cue: CueName) -> Stages:
    config = CalibrationConfig(cues=(cue,))
    data = load(drive, config)
    stages = refine_and_polish(data, initialize(data, config.initialization), config.refinement)
    return assess(data, stages, config.refinement, with_label_bleed=False, with_remedies=False)


def _values(stages: Stages) -> list[tuple[str, str, float]]:
    """List topic, limit and value of each check that has a value."""
    found = []
    if isinstance(stages.initial, Initialization) and stages.initial.runner_up_margin is not None:
        found.append(("other-mounting", "", stages.initial.runner_up_margin))
    if stages.assessment is not None:
        measured = stages.assessment.measured
        found += [(each.topic, each.limit, each.value) for each in measured if each.value is not None]
    return found
