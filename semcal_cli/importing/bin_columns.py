"""Doubts about the columns of `.bin` clouds, which have no header: what is stated is taken, but not in silence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from semcal_cli.config.point_files import AS_USUAL, PointForm
from semcal_cli.errors import InputError
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.point_clouds import read_point_clouds

PROPOSED = re.compile(r"--point-columns (\S+)( --point-type f8)?")
"""Columns that the refusal of a file with other columns than the usual ones proposes."""
MIN_BYTES = 2048
"""Size of the smallest file whose columns are tested: `MIN_WORDS` of `rust/point_cloud/record_layout.rs`."""
MIN_SHARE = 0.01
"""Smallest share of points with a negative intensity that is more than noise."""


def column_doubts(path: Path, form: PointForm, cloud: SweepCloud, max_points: int) -> list[str]:
    """Describe why the columns in which a file is read may be wrong.

    Args:
        path: The file.
        form: What is stated of it.
        cloud: Its points in these columns.
        max_points: Largest number of points of a cloud.

    Returns:
        Sentences; none for a file of another format, and for columns that fit.
    """
    if path.suffix.lower() != ".bin" or path.stat().st_size < MIN_BYTES:
        return []
    doubts = []
    fitting = [] if form.point_columns is None else _fitting(path, max_points)
    sizes = {(option.count(",") + 1, "--point-type" in option) for option in fitting}
    if fitting and (len(form.point_columns or ()), form.point_type == "f8") not in sizes:
        stated = ",".join(form.point_columns or ())
        doubts.append(
            f"point columns: {stated} are taken as stated, but {' or '.join(fitting)} fits {path.name} better"
        )
    share = 0.0 if cloud.intensity is None else float(np.mean(cloud.intensity < 0.0))
    axis = next(
        (name for name, least in zip("xyz", cloud.points.min(axis=0), strict=True) if least >= 0.0), None
    )
    if axis is not None and share >= MIN_SHARE:
        doubts.append(
            f"point columns: in {path.name}, {axis} is never negative, and the intensity is in {share:.0%} of the "
            "points: if they are in another order, --point-columns states it, such as intensity,x,y,z"
        )
    return doubts


def _fitting(path: Path, max_points: int) -> list[str]:
    """List the options that state columns which fit a file, by the test of files whose columns are not stated."""
    try:
        (cloud,) = read_point_clouds([(path, None)], max_points, AS_USUAL)
    except InputError as error:
        return [f"--point-columns {names}{kind}" for names, kind in PROPOSED.findall(str(error))]
    return ["--point-columns x,y,z,intensity" + (",ring" if cloud.ring is not None else "")]
