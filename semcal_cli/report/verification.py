"""The page about a verification: the verdict axis by axis, and both transforms on the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from semcal_cli.assessment.limits import Check, offsets_in_all
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.files.writing import write_text
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline.verification import Verification
from semcal_cli.report.edges import coloring_of
from semcal_cli.report.notations import T_notation
from semcal_cli.report.overlay import Overlays
from semcal_cli.report.palette import Coloring
from semcal_cli.report.pictures import MAX_FRAMES, make_pictures
from semcal_cli.report.template import render_page
from semcal_cli.report.words import Verdict, linked
from semcal_cli.result.applied import apply_result, seen_as
from semcal_cli.result.intervals import CHECK_NAMES

TITLES = {"pass": "Pass", "fail": "Fail", "inconclusive": "Inconclusive"}
FOUND = "found on this drive"
"""Caption of the estimate."""
BEYOND, FARTHEST = 1.25, 6.0
"""Multiple of the farthest offset that bars reach to either side, and largest multiple of what is allowed."""


def both_overlays(found: Verification, data: LoadedDrive, initial_pose: InitialPose) -> Overlays:
    """Put the transform that was verified and the one that was found beside each other, on evenly spaced frames."""
    indices = evenly_spaced(range(len(data.drive.frames)), MAX_FRAMES)
    few = data.of_frames(indices)
    poses = {initial_pose.name: initial_pose.T_camera_lidar, FOUND: found.T_camera_lidar}
    of_estimate = few.drive.model_copy(update={"time_offset_s": found.time_offset_s})
    others = {FOUND: seen_as(few.first_cue, few.drive, of_estimate)}
    by: Coloring = "edge" if coloring_of(few.first_cue) == "edge" else "agreement"
    return Overlays(few.drive, few.first_cue, poses, by, others)


def write_verification(
    found: Verification,
    data: LoadedDrive,
    initial_pose: InitialPose,
    path: Path,
) -> None:
    """Write the page.

    Args:
        found: Verdict, checks, and the pose that was found.
        data: The drive that it was found on.
        initial_pose: The transform that was verified.
        path: HTML file to write.

    Raises:
        InputError: an image is missing or wrong, or the file cannot be written. An existing file stays untouched then.
    """
    pictures = make_pictures(both_overlays(found, data, initial_pose))
    page = render_page(
        "report/verification.html",
        ("report/picture.js", "report/pictures.js"),
        verdict=Verdict(
            found.verdict,
            TITLES[found.verdict],
            found.sentence,
            "; ".join(offsets_in_all(found.checks)),
            linked(found.reasons, found.topics),
        ),
        notices=(*_camera_notices(data, initial_pose), *found.notes),
        name=initial_pose.name,
        drive=data.drive,
        checks=found.checks,
        check_names=CHECK_NAMES,
        reach=_reach(found.checks),
        pictures=pictures,
        verified=T_notation(initial_pose.T_camera_lidar),
        found=T_notation(found.T_camera_lidar),
    )
    write_text(page, path)


def _camera_notices(data: LoadedDrive, initial_pose: InitialPose) -> list[str]:
    """Say whether the camera is the one that was estimated together with the transform, and what is of the drive."""
    record = initial_pose.record
    staying = apply_result(record, data.drive, initial_pose.name)
    if record is None or not record.has_found_camera or "camera" in dict(staying.changes):
        return staying.sentences
    found = f"The camera is that of {initial_pose.name}, estimated together with the transform."
    return [found, *staying.sentences]


def _reach(checks: Sequence[Check]) -> float:
    """Choose how far all bars reach to either side, in multiples of what is allowed."""
    farthest = max((abs(check.offset) + (check.half_width or 0.0)) / check.allowed for check in checks)
    return min(BEYOND * max(1.0, farthest), FARTHEST)
