"""Whether parts of a drive agree about the pose as well as the scatter within their images predicts."""

from __future__ import annotations

import numpy as np

from semcal_cli import core
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Matrix
from semcal_cli.result.sections import CrossValidation

FOLDS_DISAGREE = Check(
    topic="folds-disagree",
    advice="check the times of sweeps and images and the motion",
    entry=Entry(
        title="Parts of the drive disagree",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "2 parts of the drive differ 4.1 times as far in yaw as the scatter within images predicts "
                "(limit 3.5): check the times of sweeps and images and the motion"
            ),
        ),
        meaning=(
            "With `--cross-validate`, the scenes are dealt into parts, and each part alone gives a pose. These poses "
            "differ by more than chance explains, so that the interval is too narrow."
        ),
        cause=(
            "Something differs from part to part that no interval knows of: the clock, the motion, the speed of the "
            "rig, a loose camera."
        ),
        remedy="State the motion and the times of points, or calibrate the parts alone and compare them.",
        figure=(
            "Scatter of the parts along an axis, relative to what their standard errors predict. Chance alone exceeds "
            "the limit on one of a hundred drives at most."
        ),
    ),
)
CHANCE = 0.01
"""Largest probability that a drive whose intervals are right exceeds the limit of any axis."""
ROUNDING = 1e-9
"""Smallest standard error that is told from rounding, metres or degrees."""


def compare_folds(
    offsets: Matrix, sigmas: Matrix, degrees_of_freedom: Matrix, num_failed: int = 0
) -> tuple[CrossValidation, tuple[Finding, ...]]:
    """Compare the poses of parts of a drive with what chance alone would make them differ.

    Along each axis, the poses `x_k` with standard errors `s_k` scatter about their weighted mean `m` by the root of
    `sum ((x_k - m) / s_k)^2 / (K - 1)`, the pull, which is one where these are right. Its square follows
    Fisher's F; the degrees of freedom of its denominator are at least those of the part that has the fewest.

    Args:
        offsets: (K, 6) offset of each part's pose from that by all frames, metres and degrees.
        sigmas: (K, 6) its standard errors, without what all parts share.
        degrees_of_freedom: (K, 6) those of the standard errors.
        num_failed: Number of further parts that do not determine a pose.

    Returns:
        The comparison, and findings against the pose.
    """
    count = len(offsets) + num_failed
    if len(offsets) < 2:
        return CrossValidation(num_folds=count, num_failed=num_failed), ()
    # An axis that some part knows exactly scatters by what rounding allows.
    weights = 1.0 / np.maximum(sigmas, ROUNDING) ** 2
    mean = (weights * offsets).sum(axis=0) / weights.sum(axis=0)
    pulls = np.sqrt((weights * (offsets - mean) ** 2).sum(axis=0) / (len(offsets) - 1))
    freedom = degrees_of_freedom.min(axis=0)
    limits = np.sqrt(
        [core.fisher_limit(CHANCE / len(pulls), len(offsets) - 1, of_axis) for of_axis in freedom]
    )
    findings, axis = list[Finding](), int(np.argmax(pulls / limits))
    if pulls[axis] > limits[axis]:
        pull, limit = format_against_limit(pulls[axis], limits[axis], 1)
        axis_name = CrossValidation.axis_name(axis)
        sentence = (
            f"{len(offsets)} parts of the drive differ {pull} times as far {axis_name} as the scatter within images "
            f"predicts (limit {limit})"
        )
        findings.append(FOLDS_DISAGREE.finding(sentence))
    spread, predicted = offsets.std(axis=0, ddof=1), np.sqrt((sigmas**2).mean(axis=0))
    result = CrossValidation(
        num_folds=count,
        num_failed=num_failed,
        spread_camera_center_m=spread[:3].tolist(),
        spread_rotation_deg=spread[3:].tolist(),
        predicted_camera_center_m=predicted[:3].tolist(),
        predicted_rotation_deg=predicted[3:].tolist(),
        pulls=pulls.tolist(),
    )
    return result, tuple(findings)
