"""The summary of a batch: a sorted line for each drive; its bytes do not depend on the machine or the duration."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from semcal_cli.batch.tasks import Outcome
from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_json_lines
from semcal_cli.files.kinds import check_own_file
from semcal_cli.files.validation import validate
from semcal_cli.files.writing import write_text
from semcal_cli.geometry.poses import camera_center, quaternion_xyzw

WORST_FIRST = (1, 3, 4, 0)
"""Exit codes of drives, the most important first."""
CSV, JSONL = "summary.csv", "summary.jsonl"
COLUMNS = (
    *("drive", "status", "exit_code", "mutual_information_nats"),
    *("translation_x_m", "translation_y_m", "translation_z_m", "qx", "qy", "qz", "qw"),
    *("camera_x_m", "camera_y_m", "camera_z_m"),
    *("sigma_camera_x_m", "sigma_camera_y_m", "sigma_camera_z_m"),
    *("sigma_rotation_x_deg", "sigma_rotation_y_deg", "sigma_rotation_z_deg"),
    *("stamp", "result", "reasons"),
)


def worst(exit_codes: Iterable[int]) -> int:
    """Exit code of a batch from those of its drives: 1 over 3 over 4 over 0."""
    return min(exit_codes, key=WORST_FIRST.index, default=0)


def write_summary(outcomes: Iterable[Outcome], folder: Path) -> None:
    """Write summary.csv and summary.jsonl.

    Raises:
        InputError: a file cannot be written.
    """
    lines, table = [], io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for outcome in sorted(outcomes, key=lambda outcome: outcome.drive):
        lines.append(json.dumps(vars(outcome)) + "\n")
        writer.writerow(_row(outcome))
    for name, text in ((JSONL, "".join(lines)), (CSV, table.getvalue())):
        check_own_file(folder / name)
        write_text(text, folder / name)


def has_summary(folder: Path) -> bool:
    """Tell whether a batch of any version left a summary of some drives in a folder."""
    path = folder / JSONL
    try:
        lines = [validate(Outcome, line, path) for line in read_json_lines(path)]
    except InputError:
        return False
    return bool(lines)


def _row(outcome: Outcome) -> list[object]:
    pose: list[object] = [""] * 10
    sigmas: list[object] = [""] * 6
    if outcome.T_camera_lidar is not None:
        T = np.array(outcome.T_camera_lidar)
        pose = [*T[:3, 3].tolist(), *quaternion_xyzw(T).tolist(), *camera_center(T).tolist()]
    if outcome.covariance is not None:
        # The covariance is of a twist on the left: rho moves the camera's centre along the camera's axes.
        deviations = np.sqrt(np.diag(np.array(outcome.covariance))).tolist()
        sigmas = [*deviations[:3], *map(math.degrees, deviations[3:])]
    known = (outcome.mutual_information_nats, outcome.stamp, outcome.result)
    information, stamp, result = ("" if value is None else value for value in known)
    head = [outcome.drive, outcome.status, outcome.exit_code, information]
    return [*head, *pose, *sigmas, stamp, result, "; ".join(outcome.reasons)]
