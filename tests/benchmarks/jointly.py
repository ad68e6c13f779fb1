"""Compares intrinsics and time offsets, estimated together with the pose, with the truth.

    python tests/benchmarks/jointly.py [--seeds 20] [--row NAME]

Takes about two minutes per seed. Writes results.csv, summary.json and table.md to a folder in `semcal_experiments`,
where a stopped run resumes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
from benchmark import OUTPUT, KeptTable, run_experiment, script
from laboratory.rates import Rate, median_and_worst
from laboratory.rigs import Case, Degrade, consecutive, row_cases, wrong

from semcal_cli.config import AdjustmentConfig, InitializationConfig, RefinementConfig
from semcal_cli.drive.camera import Camera, intrinsic_value, with_intrinsics
from semcal_cli.drive.document import Drive
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.drives import Pool, calibrate_from
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.summary import (
    NUMBER,
    SECONDS,
    Column,
    common,
    count,
    digits,
    measure_of,
    median,
)
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.reading import read_observations, remove_speckle
from semcal_cli.pipeline import initialize
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.calibration_document import CalibrationDocument

INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2")
FOCAL_SHARE, CENTER_PX, K1 = 0.03, 8.0, 0.02
"""Errors of focal lengths (relative), principal point and k1, each with a random sign."""
STANDING = ("road", "road_line", "sidewalk", "terrain", "ground")
"""Classes of a flat scene."""
FAR_OFF = 2.0
"""Error of a trusted value, in half widths of its 95 % interval, from which it counts as far off."""


def _flat(observations: Observations, rng: np.random.Generator) -> Observations:
    """Keep only the labels of the ground, on both sides."""

    def kept(names: Sequence[str]) -> np.ndarray:
        table = np.full(256, NO_CLASS, np.uint8)
        ground = [index for index, name in enumerate(names) if name in STANDING]
        table[ground] = ground
        return table

    point_classes, image_classes = kept(observations.point_class_names), kept(observations.image_class_names)
    clouds = [cloud.with_classes(point_classes[cloud.classes]) for cloud in observations.clouds]
    images = [image.with_classes(image_classes[image.classes]) for image in observations.images]
    return observations.with_clouds(clouds).with_images(images)


@dataclass(frozen=True)
class Row:
    """A row of the table: a drive, what is wrong with it, and what is estimated."""

    rig: str
    changes: dict[str, object] = field(default_factory=dict)
    """Changes to the drive's `SynthConfig`."""
    is_wrong: bool = True
    """Whether the drive's intrinsics are wrong."""
    intrinsics: tuple[str, ...] = INTRINSICS
    with_delay: bool = False
    num_pairs: int = 20
    degrade: Degrade = lambda observations, rng: observations


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
RowName = Literal[tuple(ROWS)]


@dataclass(frozen=True)
class Result:
    """What one run found; errors are estimate minus truth, or None for what was not determined."""

    row: str
    seed: int
    status: str
    """Status of the calibration, or the reason why it failed."""
    is_kept: bool = False
    """Whether the pose is that of the joint estimate."""
    rotation_deg: float = math.inf
    camera_center_cm: float = math.inf
    polished_deg: float = math.inf
    """Error of the pose before the joint estimate, with the drive's own camera and clock."""
    polished_cm: float = math.inf
    fx_percent: float | None = None
    fy_percent: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    k1: float | None = None
    clock_ms: float | None = None
    num_inside: int = 0
    """Number of true values inside the 95 % intervals: of the pose's six axes and of all other values that were
    determined."""
    num_intervals: int = 0
    is_far_off: bool = False
    """Whether the pose is trusted although a value lies more than `FAR_OFF` half widths from the truth."""
    seconds: float = 0.0
    """Time from pairs in memory to a verdict."""


def run(pool: Pool, case: Case) -> list[Result]:
    """Calibrate the faulty drive from nothing and compare with the truth."""
    row, rng = ROWS[case.row], case.rng(ROWS)
    drive, truth = pool.read(row.rig, row.changes, case.seed)
    data = _load(consecutive(drive, row.num_pairs, case.seed), row, rng)
    refinement = RefinementConfig(jointly=AdjustmentConfig(row.intrinsics, with_delay=row.with_delay))
    start = perf_counter()
    try:
        stages, found = calibrate_from(initialize(data, InitializationConfig()), data, refinement)
    except SemcalError as failure:
        return [Result(case.row, case.seed, f"failed: {failure}")]
    result = Result(case.row, case.seed, found.status, stages.is_joint, seconds=perf_counter() - start)
    return [_compared(result, found, stages, drive.camera, truth)]


def _load(drive: Drive, row: Row, rng: np.random.Generator) -> LoadedDrive:
    observations = remove_speckle(row.degrade(read_observations(drive), rng))
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
    result: Result, found: CalibrationDocument, stages: Stages, camera: Camera, truth: Pose
) -> Result:
    """Add the errors of a result, and how many true values its intervals contain."""
    error = compare_poses(found.pose, truth)
    *_, before_joint = (stage for name, stage in stages.poses.items() if name != "joint")
    before = compare_poses(before_joint.T_camera_lidar, truth)
    offsets: list[tuple[float, float]] = []
    if found.uncertainty is not None:
        offsets += zip(error.offsets.tolist(), found.uncertainty.half_widths, strict=True)
    intrinsics = {} if found.camera is None else found.camera.intrinsics
    off = {
        name: (each.found - intrinsic_value(camera, name), each.half_width_95)
        for name, each in intrinsics.items()
        if each.half_width_95 is not None
    }
    offsets += off.values()
    clock_ms = None
    if found.clock is not None and found.clock.half_width_95_s is not None:
        delay_s = 1e-3 * float(ROWS[result.row].changes["delay_ms"])  # type: ignore[arg-type]
        clock_ms = 1e3 * (found.clock.time_offset_s - delay_s)
        offsets.append((1e-3 * clock_ms, found.clock.half_width_95_s))
    (fx, _, _), (_, fy, _), _ = camera.K
    scales = {"fx": ("fx_percent", 100.0 / fx), "fy": ("fy_percent", 100.0 / fy)}
    scales |= {"cx": ("cx_px", 1.0), "cy": ("cy_px", 1.0), "k1": ("k1", 1.0)}
    return replace(
        result,
        rotation_deg=error.rotation_deg,
        camera_center_cm=error.camera_center_cm,
        polished_deg=before.rotation_deg,
        polished_cm=before.camera_center_cm,
        **{field: scale * off[name][0] for name, (field, scale) in scales.items() if name in off},  # type: ignore[arg-type]
        clock_ms=clock_ms,
        num_inside=sum(abs(x) <= half for x, half in offsets),
        num_intervals=len(offsets),
        is_far_off=found.status == "trusted" and any(abs(x) > FAR_OFF * half for x, half in offsets),
    )


PARTS = ("fx_percent", "fy_percent", "cx_px", "cy_px", "k1", "clock_ms")
"""Fields of what is estimated besides the pose."""


def _sizes(header: str, key: str, number: int, *fields: str) -> Column:
    """Make the column of the median and worst absolute value of some fields; empty where nothing was determined."""

    def spread(found: Sequence[Result]) -> tuple[float, float] | None:
        values = [getattr(result, field) for result in found for field in fields or (key,)]
        sizes = [abs(value) for value in values if value is not None]
        return median_and_worst(sizes) if sizes else None

    return Column(f"{header}: median, worst", {key: spread}, digits(number))


def _beside_before(found: Sequence[Result]) -> float:
    """Divide the median error of the pose by that of the pose before; the larger ratio, of rotation or of position."""

    def middle(field: str) -> float:
        return float(measure_of(field, median)(found))

    return max(
        middle("rotation_deg") / middle("polished_deg"), middle("camera_center_cm") / middle("polished_cm")
    )


def _is_undetermined(result: Result) -> bool:
    """Whether nothing but the pose was determined."""
    is_known = any(getattr(result, part) is not None for part in PARTS)
    return not is_known and not result.status.startswith("failed")


COLUMNS = (
    common("row", ""),
    NUMBER,
    count("kept", lambda result: result.is_kept, "num_kept"),
    count("trusted", lambda result: result.status == "trusted", "num_trusted"),
    count("not determined", _is_undetermined, "num_not_determined"),
    _sizes("rotation, deg", "rotation_deg", 4),
    _sizes("camera centre, cm", "camera_center_cm", 2),
    Column("pose error relative to before: median", {"beside_before": _beside_before}, digits(2)),
    _sizes("fx, fy off, %", "focal_percent", 3, "fx_percent", "fy_percent"),
    _sizes("cx, cy off, px", "center_px", 2, "cx_px", "cy_px"),
    _sizes("k1 off", "k1", 4),
    _sizes("clock off, ms", "clock_ms", 2),
    Column(
        "intervals right",
        {"num_inside": measure_of("num_inside", sum), "num_intervals": measure_of("num_intervals", sum)},
        lambda num_inside, num_intervals: Rate("", num_inside, num_intervals).share,
    ),
    count("trusted and far off", lambda result: result.is_far_off, "num_far_off"),
    SECONDS,
)


def main(
    *,
    seeds: int = 20,
    first_seed: int = 80_000,
    jobs: int = 1,
    row: tuple[RowName, ...] = (),
    output: Path = OUTPUT,
) -> KeptTable:
    """Calibrate in all rows or some."""
    listed = row_cases(row or ROWS, range(first_seed, first_seed + seeds))
    run_case, report = partial(run, Pool(output / "pool")), partial(Report.of, columns=COLUMNS)
    return run_experiment(Experiment("jointly", output / "jointly", listed, run_case, Result, report), jobs)


if __name__ == "__main__":
    script(main)
