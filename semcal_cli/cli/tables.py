"""Poses, hypotheses and calibrations as lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.result.stated import stated_error

if TYPE_CHECKING:
    from semcal_cli.geometry.pose_error import PoseError
    from semcal_cli.result.calibration import Calibration, Repeatability
    from semcal_cli.result.hypothesis import Hypothesis
    from semcal_cli.result.uncertainty import Uncertainty

LABEL_WIDTH = 17


def summary_lines(calibration: Calibration, written_to: str) -> list[str]:
    """Describe a calibration as lines of text, up to its verdict."""
    T, quality = calibration.pose, calibration.quality
    rows = {
        "T_camera_lidar": matrix_lines(T),
        "camera at": [f"{row(camera_center(T).tolist())} m in the LiDAR frame"],
        "looks along": [f"{row(T[2, :3].tolist())} in the LiDAR frame"],
        "labels": [
            f"{quality.label_agreement:.1%} of the pairs of {quality.num_points:,} visible points agree",
            f"they cover {quality.overlap:.0%} of the picture",
        ],
        **_uncertainty_rows(calibration.uncertainty),
        **_repeatability_rows(calibration.repeatability),
        "note": list(calibration.notes),
        "doubts": list(calibration.reasons),
        "written to": [written_to],
    }
    return [
        labelled(label, line)
        for name, lines in rows.items()
        for label, line in zip([name, *[""] * len(lines)], lines, strict=False)
    ]


def verdict_line(calibration: Calibration) -> str:
    """State the verdict with the widest 95 % intervals of the pose, and what they are in pixels 10 m away."""
    verdict = calibration.status.replace("_", " ")
    uncertainty = calibration.uncertainty
    if uncertainty is None:
        return labelled("verdict", verdict)
    return labelled("verdict", f"{verdict}: {stated_error(uncertainty, calibration.input.camera)}")


def labelled(label: str, line: str) -> str:
    """Put a label before a line."""
    return f"{label:<{LABEL_WIDTH}}{line}"


def _uncertainty_rows(uncertainty: Uncertainty | None) -> dict[str, list[str]]:
    """Describe the uncertainty of the pose; intervals are along the camera's axes."""
    if uncertainty is None:
        return {}
    center, rotation = uncertainty.half_width_95_camera_center_m, uncertainty.half_width_95_rotation_deg
    lines = [
        f"camera centre x y z +- {row([100.0 * x for x in center], 3)} cm",
        f"rotation about them +- {row(rotation, 4)} deg",
        *(f"weak {direction}" for direction in uncertainty.weak_directions),
    ]
    rows = {"95 % interval": lines}
    if uncertainty.label_bleed is not None:
        moved_cm = 100.0 * np.linalg.norm(uncertainty.label_bleed.camera_center_m)
        turned_deg = np.linalg.norm(uncertainty.label_bleed.rotation_deg)
        rows["labels 1 px off"] = [f"would move it by {moved_cm:.2f} cm and {turned_deg:.3f} deg"]
    if uncertainty.intrinsics_cost is not None:
        off_m, off_deg = uncertainty.intrinsics_cost.together
        rows["K a little off"] = [
            "cx, cy by 1 px and fx, fy by 0.1 % off would move it by "
            f"{100.0 * off_m:.2f} cm and {off_deg:.3f} deg"
        ]
    return rows


def _repeatability_rows(found: Repeatability | None) -> dict[str, list[str]]:
    if found is None or found.spread_camera_center_m is None or found.spread_rotation_deg is None:
        return {}
    center = [100.0 * x for x in found.spread_camera_center_m]
    lines = [
        f"camera centre x y z    {row(center, 3)} cm, standard deviation",
        f"rotation about them    {row(found.spread_rotation_deg, 4)} deg",
    ]
    return {f"{found.num_seeds} seeds": lines}


def hypothesis_lines(hypotheses: Sequence[Hypothesis]) -> list[str]:
    """List the hypotheses of the initial calibration."""
    head = "            MI, nats          looks along (LiDAR frame)           overlap    pairs  inliers"
    return [head, *(_hypothesis_line(number, each) for number, each in enumerate(hypotheses, start=1))]


def _hypothesis_line(number: int, hypothesis: Hypothesis) -> str:
    looks_along = " ".join(f"{x:8.4f}" for x in hypothesis.T_camera_lidar[2][:3])
    sigma = float("inf") if hypothesis.sigma_nats is None else hypothesis.sigma_nats
    return (
        f"  {number:>2}.  {hypothesis.mutual_information_nats:8.4f} +- {sigma:6.4f}   {looks_along}   "
        f"{hypothesis.overlap:7.0%}  {_count(hypothesis.num_pairs)}  {_count(hypothesis.num_inliers)}"
    )


def _count(number: int | None) -> str:
    return f"{'-' if number is None else format(number, ','):>7}"


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
