"""Intrinsics and the offset of the clock, estimated together with the pose: errors against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from semcal_cli.assessment.stages import Stages
from semcal_cli.config import InitializationConfig, JointlyConfig, RefinementConfig
from semcal_cli.drive.camera import Camera, intrinsic_value, with_intrinsics
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.drive.reading import mend, read_observations
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.pool import Pool, consecutive
from semcal_cli.experiments.rate import Rate
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.rows import Case, Degrade, calibrate_from, cases, wrong
from semcal_cli.experiments.summary import NUMBER, SECONDS, Column, common, count, digits, median, of
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.pipeline import initialize
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.camera import RefinedCamera

INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2")
FOCAL_SHARE, CENTER_PX, K1 = 0.03, 8.0, 0.02
"""By how much focal lengths, principal point and k1 are wrong, each with a random sign."""
STANDING = ("road", "road_line", "sidewalk", "terrain", "ground")
"""Classes of a flat scene."""
FAR_OFF = 2.0
"""Half widths of a 95 % interval from which on a trusted value is wrong."""


def _flat(observations: Observations, rng: np.random.Generator) -> Observations:
    """Leave only the ground labelled, on both sides."""

    def kept(names: Sequence[str]) -> np.ndarray:
        table = np.full(256, NO_CLASS, np.uint8)
        for index, name in enumerate(names):
            if name in STANDING:
                table[index] = index
        return table

    point_classes, image_classes = kept(observations.point_class_names), kept(observations.image_class_names)
    clouds = [cloud.with_classes(point_classes[cloud.classes]) for cloud in observations.clouds]
    images = [image.with_classes(image_classes[image.classes]) for image in observations.images]
    return observations.with_clouds(clouds).with_images(images)


@dataclass(frozen=True)
class Row:
    """A row of the table: a drive, what is wrong about it, and what is estimated."""

    rig: str
    changes: dict[str, object] = field(default_factory=dict)
    """Changes of the drive's `SynthConfig`."""
    is_wrong: bool = True
    """Whether the drive's intrinsics are wrong."""
    intrinsics: tuple[str, ...] = INTRINSICS
    with_delay: bool = False
    num_pairs: int = 20
    degrade: Degrade | None = None


def _clock(delay_ms: float, motion: str = "mixed") -> Row:
    changes: dict[str, object] = {"motion": motion, "delay_ms": delay_ms}
    rig = f"{motion}_{delay_ms:g}_ms".replace("-", "minus_")
    return Row(rig, changes, is_wrong=False, intrinsics=(), with_delay=True)


def _rolling(delay_ms: float) -> Row:
    row = _clock(delay_ms)
    return replace(row, rig=f"rolling_{row.rig}", changes={**row.changes, "readout_ms": 30.0})


ROWS: dict[str, Row] = {
    "intrinsics right": Row("default", is_wrong=False),
    "intrinsics wrong": Row("default"),
    "intrinsics wrong, 20 % wrong labels": Row("default", degrade=wrong(0.2)),
    "intrinsics wrong, 35-degree lens": Row("narrow", {"lens": "narrow"}),
    "intrinsics wrong, 100-degree lens": Row("wide", {"lens": "wide"}),
    "intrinsics wrong, fisheye": Row("fisheye", {"lens": "fisheye"}),
    "intrinsics wrong, one frame, 35-degree lens": Row("narrow", {"lens": "narrow"}, num_pairs=1),
    "intrinsics wrong, one frame": Row("default", num_pairs=1),
    "intrinsics wrong, flat scene": Row("default", degrade=_flat, num_pairs=10),
    "clock right": _clock(0.0),
    "clock 5 ms late": _clock(5.0),
    "clock 20 ms late": _clock(20.0),
    "clock 80 ms late": _clock(80.0),
    "clock 80 ms early": _clock(-80.0),
    "clock 20 ms late, steady speed, straight on": _clock(20.0, "steady"),
    "rolling shutter 30 ms": replace(_rolling(0.0), with_delay=False),
    "rolling shutter 30 ms, clock 20 ms late": _rolling(20.0),
}


@dataclass(frozen=True)
class Result:
    """What one run found; errors are estimate minus truth, and None of what was not determined."""

    row: str
    seed: int
    status: str
    """Status of the calibration, or the reason why it failed."""
    is_kept: bool = False
    """Whether the pose belongs to the estimate."""
    rotation_deg: float = math.inf
    camera_center_cm: float = math.inf
    polished_deg: float = math.inf
    """Error of the pose before, with what the drive says."""
    polished_cm: float = math.inf
    fx_percent: float | None = None
    fy_percent: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    k1: float | None = None
    clock_ms: float | None = None
    num_inside: int = 0
    """Number of true values inside the 95 % intervals: of the pose's six axes and of what was determined."""
    num_intervals: int = 0
    is_far_off: bool = False
    """Whether the pose is trusted, though a value lies more than `FAR_OFF` half widths from the truth."""
    seconds: float = 0.0
    """Time from pairs in memory to a verdict."""


@dataclass(frozen=True)
class Runner:
    """The settings shared by all cases; a call runs one case. It can be pickled for other processes."""

    pool: Pool

    def __call__(self, case: Case) -> list[Result]:
        """Calibrate from nothing, with what is wrong about the drive."""
        row = ROWS[case.row]
        drive, truth = self.pool.read(row.rig, row.changes, case.seed)
        data = _load(consecutive(drive, row.num_pairs, case.seed), row, case.rng(ROWS))
        refinement = RefinementConfig(jointly=JointlyConfig(row.intrinsics, with_delay=row.with_delay))
        start = perf_counter()
        try:
            stages, found = calibrate_from(initialize(data, InitializationConfig()), data, refinement)
        except SemcalError as failure:
            return [Result(case.row, case.seed, f"failed: {failure}")]
        return [_compared(case, found, stages, drive.camera, truth, perf_counter() - start)]


def _load(drive: Drive, row: Row, rng: np.random.Generator) -> LoadedDrive:
    observations = read_observations(drive)
    observations = mend(observations if row.degrade is None else row.degrade(observations, rng))
    camera = _spoiled(drive.camera, rng) if row.is_wrong else drive.camera
    spoiled = drive.model_copy(update={"camera": camera})
    return LoadedDrive(spoiled, replace(observations, camera=camera))


def _spoiled(camera: Camera, rng: np.random.Generator) -> Camera:
    """Make the intrinsics of a camera wrong."""
    sizes = {"fx": FOCAL_SHARE * camera.K[0][0], "fy": FOCAL_SHARE * camera.K[1][1]}
    sizes |= {"cx": CENTER_PX, "cy": CENTER_PX, "k1": K1}
    signs = rng.choice((-1.0, 1.0), len(sizes))
    changed = {
        name: intrinsic_value(camera, name) + float(sign) * size
        for (name, size), sign in zip(sizes.items(), signs, strict=True)
    }
    return with_intrinsics(camera, changed)


def _compared(
    case: Case, found: Calibration, stages: Stages, camera: Camera, truth: Pose, seconds: float
) -> Result:
    """Compare a result with the truth."""
    row = ROWS[case.row]
    error = compare_poses(found.pose, truth)
    *_, (_, before_joint) = ((name, stage) for name, stage in stages.poses.items() if name != "joint")
    before = compare_poses(before_joint.T_camera_lidar, truth)
    offsets: list[tuple[float, float]] = []
    if found.uncertainty is not None:
        offsets += zip(error.offsets.tolist(), found.uncertainty.half_widths, strict=True)
    off = {} if found.camera is None else _off(found.camera, camera)
    offsets += off.values()
    clock_ms = None
    if found.clock is not None and found.clock.half_width_95_s is not None:
        delay_s = 1e-3 * float(row.changes["delay_ms"])  # type: ignore[arg-type]
        clock_ms = 1e3 * (found.clock.time_offset_s - delay_s)
        offsets.append((1e-3 * clock_ms, found.clock.half_width_95_s))
    is_kept = stages.is_joint
    (fx, _, _), (_, fy, _), _ = camera.K

    def value(name: str, scale: float = 1.0) -> float | None:
        return scale * off[name][0] if name in off else None

    return Result(
        row=case.row,
        seed=case.seed,
        status=found.status,
        is_kept=is_kept,
        rotation_deg=error.rotation_deg,
        camera_center_cm=error.camera_center_cm,
        polished_deg=before.rotation_deg,
        polished_cm=before.camera_center_cm,
        fx_percent=value("fx", 100.0 / fx),
        fy_percent=value("fy", 100.0 / fy),
        cx_px=value("cx"),
        cy_px=value("cy"),
        k1=value("k1"),
        clock_ms=clock_ms,
        num_inside=sum(abs(x) <= half for x, half in offsets),
        num_intervals=len(offsets),
        is_far_off=found.status == "trusted" and any(abs(x) > FAR_OFF * half for x, half in offsets),
        seconds=seconds,
    )


def _off(found: RefinedCamera, camera: Camera) -> dict[str, tuple[float, float]]:
    """Give the errors of the intrinsics that are determined, with the half widths of their intervals."""
    return {
        name: (each.found - intrinsic_value(camera, name), each.half_width_95)
        for name, each in found.intrinsics.items()
        if each.half_width_95 is not None
    }


PARTS = ("fx_percent", "fy_percent", "cx_px", "cy_px", "k1", "clock_ms")
"""Fields of what is estimated beside the pose."""


def _sizes(*names: str) -> Callable[[Sequence[Result]], tuple[float, float] | None]:
    """Compute the median and the worst size of some fields; None where nothing was determined."""

    def spread(found: Sequence[Result]) -> tuple[float, float] | None:
        values = [getattr(result, name) for result in found for name in names]
        sizes = [abs(value) for value in values if value is not None]
        return (median(sizes), max(sizes)) if sizes else None

    return spread


def _beside_before(found: Sequence[Result]) -> float:
    """Divide the median error of the pose by that of the pose before, in rotation or place, whichever is larger."""
    pairs = (("rotation_deg", "polished_deg"), ("camera_center_cm", "polished_cm"))
    medians = [[median([getattr(result, name) for result in found]) for name in pair] for pair in pairs]
    return max(after / before for after, before in medians)


def _is_undetermined(result: Result) -> bool:
    """Whether nothing beside the pose was determined."""
    is_known = any(getattr(result, part) is not None for part in PARTS)
    return not is_known and not result.status.startswith("failed")


COLUMNS = (
    common("row", ""),
    NUMBER,
    count("kept", "num_kept", lambda result: result.is_kept),
    count("trusted", "num_trusted", lambda result: result.status == "trusted"),
    count("not determined", "num_not_determined", _is_undetermined),
    Column("rotation, deg: median, worst", {"rotation_deg": _sizes("rotation_deg")}, digits(4)),
    Column("camera centre, cm: median, worst", {"camera_center_cm": _sizes("camera_center_cm")}, digits(2)),
    Column("pose beside that before, times: median", {"beside_before": _beside_before}, digits(2)),
    Column("fx, fy off, %: median, worst", {"focal_percent": _sizes("fx_percent", "fy_percent")}, digits(3)),
    Column("cx, cy off, px: median, worst", {"center_px": _sizes("cx_px", "cy_px")}, digits(2)),
    Column("k1 off: median, worst", {"k1": _sizes("k1")}, digits(4)),
    Column("clock off, ms: median, worst", {"clock_ms": _sizes("clock_ms")}, digits(2)),
    Column(
        "intervals true",
        {"num_inside": of("num_inside", sum), "num_intervals": of("num_intervals", sum)},
        lambda num_inside, num_intervals: Rate("", num_inside, num_intervals).share,
    ),
    count("trusted and far off", "num_far_off", lambda result: result.is_far_off),
    SECONDS,
)


def report(results: Sequence[Result]) -> Report:
    """Sum up the results of each row."""
    return Report.of(results, COLUMNS)


def experiment(out: Path, seeds: range, rows: Sequence[str]) -> Experiment[Case, Result]:
    """Declare the experiment on some keys of `ROWS`, or on all if none are given."""
    chosen = cases(rows or ROWS, seeds)
    return Experiment("jointly", out / "jointly", chosen, Runner(Pool(out / "pool")), Result, report)
