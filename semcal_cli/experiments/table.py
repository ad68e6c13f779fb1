"""One drive with a reference, calibrated by every method from the same start, for tables and figures like the paper's.

The tables follow Jiang, Osteen and Saripalli, arXiv 2104.12023, whose columns "roll, pitch, yaw" contain the rotation
vector of T_camera_lidar in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from semcal_cli import core
from semcal_cli.config import InitializationConfig, RefinementConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError, SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.drives import calibrate_from
from semcal_cli.experiments.experiment_run import RESULTS, SUMMARY, TABLE, Report
from semcal_cli.experiments.methods import METHODS, Scene
from semcal_cli.experiments.published import PublishedRow, published_rows
from semcal_cli.experiments.soic import Soic
from semcal_cli.experiments.soic_config import SoicConfig
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.files.image_files import write_image
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, mounting_rpy_deg, rotation_vector_deg
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_frame_image
from semcal_cli.pipeline import initialize
from semcal_cli.report.overlays import Overlays, with_legend
from semcal_cli.result.calibration_document import Status

ORDER = (
    *("SOIC", "PMI as published", "PMI", "PMI, MINE and polish"),
    *("paper, own start", "paper", "semcal", "semcal, MINE and polish"),
)
HEADERS = (
    *("", "rotation vector, deg", "translation, m", "roll, pitch, yaw, deg"),
    *("off the reference", "MI, nats", "distance, px", "s"),
)
IMAGES = ("reference", "SOIC", "PMI", "semcal")
"""Poses that images (a) to (d) show, in the paper's order."""
IMAGE_FILES = tuple(f"{letter}_{name.lower()}.png" for letter, name in zip("abcd", IMAGES, strict=True))
FILES = (RESULTS, SUMMARY, TABLE, *IMAGE_FILES)
LEGEND = (
    "Rotation vector and translation are T_camera_lidar's. Roll, pitch and yaw: the camera's body frame (x forward, "
    "y left, z up) in the LiDAR frame, R = Rz(yaw) Ry(pitch) Rx(roll). MI: of the labels. Distance: from points to "
    "pixels of their class, averaged over classes. s: from pairs in memory to a pose; semcal's includes its assessment."
)


@dataclass
class MethodComparison:
    """The poses of every method on a drive."""

    drive: Drive
    labels: Observations
    poses: dict[str, Pose]
    """T_camera_lidar (4, 4) by name: `reference`, `start`, and each method with an answer."""
    published: tuple[PublishedRow, ...] = ()
    """The paper's rows, if the drive's reference is that of one of the paper's data sets."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time by method, from pairs in memory to a pose; semcal's includes its assessment."""
    failures: dict[str, str] = field(default_factory=dict)
    """Why a method has no answer, by method."""
    status: Status | None = None
    """Status of semcal's own pose; the other methods have none."""
    reasons: tuple[str, ...] = ()


def compare(
    data: LoadedDrive,
    T_reference: Pose,
    initial_pose: InitialPose | None,
    frame: int,
    progress: Callable[[str], None],
) -> MethodComparison:
    """Calibrate a drive by every method.

    Args:
        data: Drive loaded by `load`.
        T_reference: (4, 4) T_camera_lidar to compare with.
        initial_pose: Start of all methods; None starts at the result of the initial calibration.
        frame: Frame of the drawn images.
        progress: Called with a description of each step.

    Raises:
        InputError: a file is missing or not what its name or the drive says, or there is no such frame.
        CalibrationError: labels cannot be compared at all.
    """
    if frame >= len(data.drive.frames):
        num_frames = len(data.drive.frames)
        raise InputError(f"{data.drive.path}: found {num_frames} frames, expected one numbered {frame}")
    # The image is checked before the long computation.
    read_frame_image(data.drive, data.drive.frames[frame])
    progress(
        "searching all mounting directions" if initial_pose is None else f"starting at {initial_pose.name}"
    )
    initial = initialize(data, InitializationConfig(), initial_pose=initial_pose)
    T_init = initial.T_camera_lidar if initial_pose is None else initial_pose.T_camera_lidar
    poses = {"reference": T_reference, "start": T_init}
    comparison = MethodComparison(data.drive, data.observations, poses, published_rows(T_reference))
    scene = Scene(data.drive, is_initialized=initial_pose is None)
    for method in ORDER:
        progress(f"calibrating by {method}")
        try:
            observations = METHODS[method].prepare(scene)
            start = perf_counter()
            if method == "semcal":
                stages, verdict = calibrate_from(initial, data, RefinementConfig())
                poses[method] = stages.T_camera_lidar
                comparison.status, comparison.reasons = verdict.status, verdict.reasons
            else:
                poses[method] = METHODS[method].find(scene, observations, T_init)
            comparison.seconds[method] = perf_counter() - start
        except SemcalError as failure:
            comparison.failures[method] = str(failure)
    return comparison


@dataclass(frozen=True)
class Row:
    """A transform, and its error against the reference."""

    method: str
    rotation_vector_x_deg: float
    """First component of the rotation vector of T_camera_lidar; the translation is also that of T_camera_lidar."""
    rotation_vector_y_deg: float
    rotation_vector_z_deg: float
    translation_x_m: float
    translation_y_m: float
    translation_z_m: float
    roll_deg: float
    """Roll of the camera's body frame in the LiDAR frame, R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch_deg: float
    yaw_deg: float
    rotation_error_deg: float
    camera_center_error_cm: float
    mutual_information_nats: float
    """Mutual information of the labels."""
    distance_px: float | None
    """SOIC's cost, the distance of points from pixels of their class; None if the two sides share no class name."""

    @property
    def cells(self) -> tuple[str, str, str]:
        """Rotation vector, translation and angles as text."""
        values = list(vars(self).values())[1:10]
        x, y, z = (", ".join(f"{v:.2f}" for v in np.round(values[k : k + 3], 2) + 0.0) for k in (0, 3, 6))
        return x, y, z


def describe(comparison: MethodComparison) -> list[Row]:
    """Describe the reference, the paper's poses, the start, and the pose of each method."""
    try:
        soic = Soic(comparison.labels, SoicConfig())
    except CalibrationError:
        soic = None
    rows = []
    T_reference = comparison.poses["reference"]
    published = {row.method: row.T_camera_lidar for row in comparison.published}
    for method, T in ({"reference": T_reference} | published | comparison.poses).items():
        error = compare_poses(T, T_reference)
        cost = math.inf if soic is None else soic.cost(T)
        values: list[Any] = [
            method,
            *rotation_vector_deg(T).tolist(),
            *T[:3, 3].tolist(),
            *mounting_rpy_deg(T).tolist(),
            error.rotation_deg,
            error.camera_center_cm,
            core.agreement(comparison.labels.core, T).mutual_information,
            cost if math.isfinite(cost) else None,
        ]
        rows.append(Row(*values))
    return rows


def markdown(comparison: MethodComparison, rows: Sequence[Row]) -> str:
    """Format the table."""
    lines = []
    for row in rows:
        error = f"{row.rotation_error_deg:.3f} deg, {row.camera_center_error_cm:.1f} cm"
        error_text = "" if row.method == "reference" else error
        distance = "" if row.distance_px is None else f"{row.distance_px:.2f}"
        seconds = f"{comparison.seconds[row.method]:.1f}" if row.method in comparison.seconds else ""
        information = f"{row.mutual_information_nats:.4f}"
        lines.append((row.method, *row.cells, error_text, information, distance, seconds))
    table = markdown_table(HEADERS, lines)
    # Rows without an answer are appended, because their empty cells have another width.
    table += "".join(
        f"| {method} | failed: {_cell(text)} | | | | | | |\n" for method, text in comparison.failures.items()
    )
    notes = [LEGEND, *(f"{_cell(row.method).capitalize()}: {row.source}." for row in comparison.published)]
    verdict = f"semcal's own verdict: {'; '.join([comparison.status or 'failed', *comparison.reasons])}."
    return "\n\n".join([table.rstrip("\n"), *notes, f"{verdict}\n"])


def _cell(text: str) -> str:
    """Escape a text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def write_table(comparison: MethodComparison, frame: int, folder: Path) -> str:
    """Write CSV, JSON, the table and the images of a frame into a folder, and return the table.

    Raises:
        InputError: a file cannot be written.
    """
    rows = describe(comparison)
    table = markdown(comparison, rows)
    facts = {
        "drive": str(comparison.drive.path),
        "status": comparison.status,
        "reasons": comparison.reasons,
        "seconds": comparison.seconds,
        "failures": comparison.failures,
        "published": [vars(row) for row in comparison.published],
    }
    Report([vars(row) for row in rows], table, facts=facts).write("table", rows, folder)
    _write_images(comparison, frame, folder)
    return table


def _write_images(comparison: MethodComparison, frame: int, folder: Path) -> None:
    """Draw the points of a frame at each pose, one image each, as in the paper's (a) to (d)."""
    images, legend = Overlays(comparison.drive, comparison.labels, comparison.poses).draw(frame)
    for file, method in zip(IMAGE_FILES, IMAGES, strict=True):
        path = folder / file
        # An image of an earlier run would be mistaken for one of this run.
        path.unlink(missing_ok=True)
        if method in images:
            write_image(with_legend({f"({file[0]}) {method}": images[method]}, legend), path)
