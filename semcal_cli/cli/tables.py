"""Poses, hypotheses and calibrations as lines of text."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from semcal_cli.checks import precedence
from semcal_cli.errors import counted, listed
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, compare_poses
from semcal_cli.observations.cues.cue_table import cues_of_options, policy_of
from semcal_cli.readable import figure, for_people, lengths
from semcal_cli.result.refined_camera import clock_sentence, intrinsic_texts, kept_sentence
from semcal_cli.result.uncertainty import stated_error

if TYPE_CHECKING:
    from semcal_cli.estimation.search.mounting import Mounting
    from semcal_cli.fleet.fleet_drives import FleetDrive
    from semcal_cli.geometry.poses import PoseError
    from semcal_cli.result.calibration_document import CalibrationDocument
    from semcal_cli.result.next_steps import Rows
    from semcal_cli.result.sections import CrossValidation, Repeatability
    from semcal_cli.result.uncertainty import Uncertainty

COLUMNS = 80
LABEL_WIDTH = 17
NO_BREAK = "\u00a0"
"""Space at which no line is wrapped."""
UNBROKEN = re.compile(r"\d %| (±|\+-) (?=\d)|\+- (?=\d)")
MAX_GROUPS = 8
"""Largest number of groups of drives that are listed."""
WITHOUT_CHECKS = {
    "initial": "a rough start, not refined yet",
    "not_assessed": "its uncertainty is not known",
    "paper": "the paper's method checks nothing, so the pose may be far off",
}
"""What is said of a result that was not assessed."""


def summary_lines(calibration: CalibrationDocument, *, verbose: bool = False) -> list[str]:
    """Describe a calibration as lines of text, up to where it is written.

    Args:
        calibration: The calibration.
        verbose: Whether to add expert figures: how well points and pixels agree.
    """
    T = calibration.pose
    rows = [
        *zip(["T_camera_lidar", "", "", ""], matrix_lines(T), strict=True),
        *pose_rows(T),
        *_start_rows(calibration),
        *(_label_rows(calibration) if verbose else ()),
        *_uncertainty_rows(calibration.believed_uncertainty),
        *_camera_rows(calibration),
        *_repeatability_rows(calibration.repeatability),
        *_fold_rows(calibration.cross_validation),
        *(("note", note) for note in calibration.notes),
        *(
            ("doubt", reason)
            for reason in shown_reasons(calibration.reasons, calibration.topics, verbose=verbose)
        ),
    ]
    return [line for label, text in rows for line in wrapped(label, text)]


def _start_rows(calibration: CalibrationDocument) -> Rows:
    """Describe how far a transform is from the one that it started at; a search has no such start."""
    initial = calibration.stages.get("initial")
    if initial is None or len(calibration.hypotheses) > 1 or len(calibration.stages) < 2:
        return []
    moved = compare_poses(calibration.pose, np.array(initial.T_camera_lidar))
    rotation, center = figure(moved.rotation_deg), lengths([moved.camera_center_m])
    return [("from the start", f"{rotation} degrees and {center} away")]


def pose_rows(T: Pose) -> Rows:
    """Describe where a pose puts the camera."""
    return [
        ("camera at", f"{row(camera_center(T).tolist())} m in the LiDAR frame"),
        ("looks along", f"{row(T[2, :3].tolist())} in the LiDAR frame"),
    ]


def group_rows(groups: Sequence[Sequence[FleetDrive]]) -> Rows:
    """Describe which drives agree, where no pose belongs to all of them."""
    num_drives = sum(map(len, groups))
    rows: Rows = [
        ("agreed pose", f"none: {num_drives:,} trusted drives fall into {len(groups):,} groups that differ")
    ]
    for number, group in enumerate(groups[:MAX_GROUPS], start=1):
        assert group[0].T_camera_lidar is not None
        rows += [
            (
                f"group {number}",
                f"{counted(len(group), 'drive')}: {listed(sorted(drive.name for drive in group))}",
            ),
            *pose_rows(group[0].T_camera_lidar),
        ]
    if len(groups) > MAX_GROUPS:
        rows.append(("", f"and {counted(len(groups) - MAX_GROUPS, 'group')} more"))
    num_cameras = len({drive.camera for group in groups for drive in group})
    if num_cameras > 1:
        rows.append(("note", f"the drives have {num_cameras:,} different cameras, given or estimated"))
    return rows


def verdict_lines(calibration: CalibrationDocument, *, is_alone: bool = False) -> list[str]:
    """State the verdict, and how sure it is; alone, without the reasons above it.

    A trusted pose is given with its widest 95 % intervals, and their size in pixels at 10 m.
    """
    status = calibration.status
    is_start = status == "not_assessed" and [*calibration.stages] == ["initial"]
    case = "initial" if is_start else "paper" if "paper" in calibration.settings.options else status
    how_good = figures(calibration) or WITHOUT_CHECKS.get(case, "")
    see = ", see above" if status == "not_trusted" and not is_alone else ""
    return verdict_line(status, how_good + see).splitlines()


def verdict_line(status: str, how_good: str) -> str:
    """Write the line that every command with a verdict ends with: the verdict, then what decides it.

    Args:
        status: The verdict, or the status of a result.
        how_good: The figures or reasons that decide it; may be empty.
    """
    verdict = ": ".join(filter(None, [status.replace("_", " "), how_good]))
    return "\n".join(wrapped("verdict", verdict))


def figures(calibration: CalibrationDocument) -> str:
    """Describe how many doubts there are about a calibration, or else its interval; empty if that is not known."""
    if calibration.status == "not_trusted":
        leading = (
            precedence.leading(calibration.topics).num if calibration.topics else len(calibration.reasons)
        )
        more = len(calibration.reasons) - leading
        return counted(leading, "doubt") + (f", and {more} that may follow" if more else "")
    uncertainty = calibration.believed_uncertainty
    if uncertainty is None:
        return ""
    error = stated_error(uncertainty, calibration.used_camera)
    return (
        error
        if calibration.is_camera_confirmed
        else f"{error}, if K is right, which these frames do not show"
    )


def shown_reasons(reasons: Sequence[str], topics: Sequence[str], *, verbose: bool = False) -> list[str]:
    """List the leading reasons, and count those that may follow from them; all if `verbose`."""
    leading = len(reasons) if verbose or not topics else precedence.leading(topics).num
    if leading == len(reasons):
        return [*reasons]
    return [*reasons[:leading], f"{len(reasons) - leading} more may follow from this (--verbose lists them)"]


def wrapped_lines(text: str, columns: int) -> list[str]:
    """Wrap a text between words; names, intervals with their signs, and figures with their per cent stay whole."""
    whole = UNBROKEN.sub(lambda found: found[0].replace(" ", NO_BREAK), text)
    lines = textwrap.wrap(whole, columns, break_long_words=False, break_on_hyphens=False)
    return [line.replace(NO_BREAK, " ") for line in lines]


def wrapped(label: str, text: str, indent: int = LABEL_WIDTH) -> list[str]:
    """Put a label before a text and wrap it at `COLUMNS`; later lines are indented."""
    first, *rest = wrapped_lines(for_people(text), COLUMNS - indent) or [""]
    return [f"{label:<{indent}}{first}".rstrip(), *(f"{'':<{indent}}{line}" for line in rest)]


def labelled(label: str, line: str, indent: int = LABEL_WIDTH) -> str:
    """Put a label before a line that is never wrapped, such as a path."""
    return f"{label:<{indent}}{for_people(line)}"


def _label_rows(calibration: CalibrationDocument) -> Rows:
    """Describe how well points and pixels agree; the share that agrees, only where it falls at a wrong pose."""
    quality = calibration.quality
    visible = f"{quality.num_points:,} are visible, and cover {quality.overlap:.0%} of the image"
    rows = [("points", visible)]
    if policy_of(cues_of_options(calibration.settings.options)).starts is None:
        rows.append(("", f"{quality.label_agreement:.1%} of them agree with their pixels"))
    if quality.turn_loss is not None:
        rows.append(("turned by 5 deg", f"the camera loses {quality.turn_loss:.0%} of the information"))
    return rows


def _uncertainty_rows(uncertainty: Uncertainty | None) -> Rows:
    """Describe the uncertainty of the pose; intervals are along the camera's axes."""
    if uncertainty is None:
        return []
    center, rotation = uncertainty.half_width_95_camera_center_m, uncertainty.half_width_95_rotation_deg
    rows = [
        ("95 % interval", f"camera centre right, down, forward +- {lengths(center)}"),
        ("", f"rotation pitch, yaw, roll +- {' '.join(map(figure, rotation))} degrees"),
        *(("least certain", direction) for direction in uncertainty.weak_directions),
    ]
    if uncertainty.label_bleed is not None:
        moved = lengths([float(np.linalg.norm(uncertainty.label_bleed.camera_center_m))])
        rotation_deg = float(np.linalg.norm(uncertainty.label_bleed.rotation_deg))
        sentence = f"borders 1 px off would move the camera by {moved} and {figure(rotation_deg)} degrees"
        rows.append(("sensitivity", f"to labels: {sentence}"))
    if uncertainty.intrinsics_cost is not None:
        off_m, off_deg = uncertainty.intrinsics_cost.together
        errors = "errors of 1 px in cx, cy and 0.1 % in fx, fy"
        moved = f"{lengths([off_m])} and {figure(off_deg)} degrees"
        label = "" if uncertainty.label_bleed is not None else "sensitivity"
        rows.append((label, f"to K: {errors} would move the camera by {moved}"))
    return rows


def _camera_rows(calibration: CalibrationDocument) -> Rows:
    """Describe the intrinsics and the clock that were estimated together with the pose."""
    lines, is_trusted = [], calibration.is_believed
    if (camera := calibration.camera) is not None:
        lines = [
            *(intrinsic.line for intrinsic in intrinsic_texts(camera, is_trusted=is_trusted)),
            kept_sentence(camera),
        ]
    rows = [("" if number else "intrinsics", line) for number, line in enumerate(lines)]
    return (
        rows
        if calibration.clock is None
        else [*rows, ("clock", clock_sentence(calibration.clock, is_trusted=is_trusted))]
    )


def _repeatability_rows(repeatability: Repeatability | None) -> Rows:
    if (
        repeatability is None
        or repeatability.spread_camera_center_m is None
        or repeatability.spread_rotation_deg is None
    ):
        return []
    center = repeatability.spread_camera_center_m
    return [
        (f"{repeatability.num_seeds} seeds", f"camera centre right, down, forward {lengths(center)}"),
        ("", f"rotation pitch, yaw, roll {' '.join(map(figure, repeatability.spread_rotation_deg))} degrees"),
        ("", "standard deviations"),
    ]


def _fold_rows(folds: CrossValidation | None) -> Rows:
    if folds is None:
        return []
    name = f"{folds.num_folds} parts"
    if folds.spread_camera_center_m is None or folds.spread_rotation_deg is None:
        return [
            (name, f"{folds.num_failed} of them do not determine a pose alone: add frames from other places")
        ]
    return [
        (
            name,
            f"camera centre right, down, forward {lengths(folds.spread_camera_center_m)}",
        ),
        ("", f"rotation pitch, yaw, roll {' '.join(map(figure, folds.spread_rotation_deg))} degrees"),
        ("", f"against predicted {' '.join(map(figure, folds.pulls or ()))}"),
        ("", "standard deviations; 1 where the intervals are right"),
    ]


def hypothesis_lines(hypotheses: Sequence[Mounting], *, verbose: bool = False) -> list[str]:
    """List the hypotheses of the initial calibration, best first.

    Args:
        hypotheses: The hypotheses.
        verbose: Whether to list mutual information and matches instead of how far each is from the best.
    """
    axes = f"{'looks along (LiDAR frame)':<27}{'covers':>7}"
    if verbose:
        head = f"      {axes}{'MI, nats':>12}{'pairs':>18}{'inliers':>10}"
    else:
        head = f"      {axes}{'turned by':>14}{'behind the best':>18}"
    best = hypotheses[0]
    rows = [
        _expert_figures(mounting) if verbose else _figures_beside(best, mounting) for mounting in hypotheses
    ]
    return [
        head,
        *(
            f"  {number:>2}. {row(mounting.T_camera_lidar[2][:3], 4):<27}{mounting.overlap:>7.0%}{figures}".rstrip()
            for number, (mounting, figures) in enumerate(zip(hypotheses, rows, strict=True), start=1)
        ),
    ]


def _figures_beside(best: Mounting, other: Mounting) -> str:
    if other is best:
        return f"{'-':>14}{'-':>18}"
    return f"{other.rotation_from_best_deg:10.1f} deg{best.margin(other):12.1f} sigma"


def _expert_figures(hypothesis: Mounting) -> str:
    sigma = float("inf") if hypothesis.sigma_nats is None else hypothesis.sigma_nats
    information = f"{hypothesis.mutual_information_nats:.4f} +- {sigma:.4f}"
    return f"{information:>20}{_count(hypothesis.num_pairs)}{_count(hypothesis.num_inliers)}"


def _count(number: int | None) -> str:
    return f"{'-' if number is None else format(number, ','):>10}"


def error_lines(error: PoseError) -> list[str]:
    """Describe the difference between a calibration and a reference."""
    return [
        f"rotation       {error.rotation_deg:8.4f} deg   x y z {row(error.rotation_xyz_deg)} deg",
        f"camera centre  {error.camera_center_cm:8.3f} cm    x y z {row(error.camera_center_xyz_cm)} cm",
    ]


def matrix_lines(T: Pose) -> list[str]:
    """Format a transform, one row on each line."""
    return [row(values) for values in T.tolist()]


def row(values: Sequence[float], digits: int = 6) -> str:
    """Format numbers side by side."""
    return " ".join(f"{value:{digits + 4}.{digits}f}" for value in np.round(values, digits) + 0.0)
