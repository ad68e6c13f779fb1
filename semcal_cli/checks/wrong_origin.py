"""Whether the rays of the LiDAR start where the drive says, by default at the origin of the points."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.estimation.search.ray_origin import FARTHEST_M, STEPS_M, find_ray_origin, place_text
from semcal_cli.files.input_files import read_start
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE
from semcal_cli.geometry.arrays import Points

WRONG_ORIGIN = Check(
    topic="wrong-origin",
    advice="edges, segments and occlusion need the true place",
    explains=OF_A_WRONG_POSE | {"far-start"},
    entry=Entry(
        title="Rays start elsewhere than at the origin of the points",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "seen from [0.00, 0.00, 0.00], ranges of neighbouring rays jump 2.6 times as much as seen from "
                "[1.38, 0.00, 1.63]: `origin_m: [1.38, 0.00, 1.63]` under `lidar:` states where the rays start: "
                "edges, segments and occlusion need the true place"
            ),
            (
                "seen from [0.00, 0.00, 0.00], ranges of neighbouring rays jump 2.3 times as much as seen from 4 m "
                "away: the rays seem to start farther away, or the columns of the files are mixed up "
                "(`point_columns`): edges, segments and occlusion need the true place"
            ),
            (
                "`origin_m: [0.00, 0.00, 100.00]` under `lidar:` may be wrong: seen from there, half of the points are "
                "within 102 m, usually 0.5 to 100, and seen from the origin of the points, all is as usual: edges, "
                "segments and occlusion need the true place"
            ),
        ),
        meaning="Seen from the stated place, near surfaces lie behind far ones, and what looks like an edge is none.",
        cause="Points are in the frame of the vehicle, as those of DDAD and Argoverse 2, the stated place is wrong, or "
        "columns are swapped.",
        remedy="Correct or remove `origin_m` where the drive states it. Otherwise state `origin_m: [x, y, z]` under "
        "`lidar:`, or `--origin X Y Z` at import. The place that is found is good to 20 cm; the data set's own is "
        "better.",
    ),
)
VIEWPOINT_UNUSED = Check(
    topic="viewpoint",
    advice="if points are in a frame in which rays start there, state it as `origin_m` under `lidar:`",
    entry=Entry(
        title="PCD files state a viewpoint",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "000000.pcd: VIEWPOINT states [1.40, 0.10, 1.70], which is not used: if points are in a frame in "
                "which rays start there, state it as `origin_m` under `lidar:`"
            ),
        ),
        meaning="Programs write there where rays start, or the pose of the LiDAR on a map, and nothing tells which.",
        cause="Points are in the frame of the vehicle, or the files are those of a map.",
        remedy="`semcal inspect DRIVE --find-origin` finds from the points where rays start; state it if it agrees.",
    ),
)
VIEWPOINT = re.compile(rb"^VIEWPOINT((?:[ \t]+[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?){3})\s", re.MULTILINE)
"""The line of a PCD header with a place, whose other four numbers are a rotation."""
HEADER_BYTES = 4096
MIN_DISTANCE_M = 1.0
"""Lasers of an HDL-64E start 12 to 20 cm from the origin, and the place that is found is good to some 20 cm. Where real
sweeps were moved by 0.7 m, the ratio was 1.1 to 1.9; that of one cloud accumulated from a VLP-16 is 2.1 at 0.5 m."""


def check_origin(drive: Drive, clouds: Sequence[Points]) -> tuple[Finding, ...]:
    """Check that rays (N, 3) of each sweep, from the stated place to the points, do not start elsewhere, metres."""
    # Where rays do not start, a place a metre away is better: one sweep tells, and most drives end here.
    if not find_ray_origin(clouds[:1], STEPS_M[:1]).origin_m.any():
        return ()
    stated_m = np.array(drive.origin_m)
    # From a stated place that is far off, a descent does not come back to the points' own origin.
    found = find_ray_origin(clouds, start_m=-stated_m)
    if not found.is_clear or np.linalg.norm(found.origin_m) < MIN_DISTANCE_M:
        return ()
    here, there = (place_text(place) for place in (stated_m, stated_m + found.origin_m))
    what = f"`origin_m: {there}` under `lidar:` states where the rays start"
    if found.is_at_limit:
        there = f"{FARTHEST_M:.0f} m away"
        what = (
            "the rays seem to start farther away, or the columns of the files are mixed up (`point_columns`)"
        )
    times = f"{found.ratio:.1f} times as much as seen from {there}"
    rough = f"seen from {here}, ranges of neighbouring rays jump {times}"
    return (WRONG_ORIGIN.finding(f"{rough}: {what}"),)


def check_viewpoint(drive: Drive) -> tuple[Finding, ...]:
    """Check that PCD files, whose VIEWPOINT may be where the rays start or the pose of a moving LiDAR, state none.

    The first file of the drive is read, which has to be there.
    """
    first = drive.resolve(drive.frames[0].points)
    if first.suffix.lower() != ".pcd" or any(drive.origin_m):
        return ()
    stated = VIEWPOINT.search(read_start(first, HEADER_BYTES))
    place_m = np.array([0.0, 0.0, 0.0] if stated is None else stated[1].split(), float)
    if not np.isfinite(place_m).all() or not place_m.any():
        return ()
    return (VIEWPOINT_UNUSED.finding(f"{first}: VIEWPOINT states {place_text(place_m)}, which is not used"),)
