"""Whether clouds agree less well with the label images of other frames."""

from __future__ import annotations

import numpy as np

from semcal_cli import core
from semcal_cli.checks.pose_fit import NO_FIT, fit_at, relative_information
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import compared_by
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

WRONG_PAIRING = Check(
    topic="wrong-pairing",
    advice="compare times and names to check that sweeps and images belong together",
    entry=Entry(
        title="Images of other frames fit as well",
        section=PageSection.FILES,
        quotes=(
            (
                "images of other frames fit these sweeps 80% as well as their own (limit 55%): "
                "compare times and names to check that sweeps and images belong together"
            ),
        ),
        meaning=(
            "Swapping images between frames reduces the agreement too little, so the pairing is "
            "probably wrong."
        ),
        cause="Files were paired by number although one side lost some, or the clocks of the sensors differ.",
        remedy="Look at the stamps and at one overlay. `semcal import` pairs by time.",
        figure=(
            "Information of point clouds with images of other frames, relative to that with their "
            "own. The check needs two frames that show different scenes."
        ),
    ),
)
MAX_ALIKE = 0.8
"""Largest fraction of equal pixels at which exchanging two label images is informative."""
MAX_SHARED = 0.4
"""Largest fraction of equal ranges in the sweeps of two frames at which exchanging them is informative. Frames of
synthetic drives share at most 0.24; in a real jam, frames 2.4 seconds apart share 0.21 to 0.57."""


def check_pairing(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that clouds agree less well with the label images of other frames."""
    # All images, the own ones too, are compared by their likeliest classes: probabilities carry less information.
    images, exchanged = [image.without_shares() for image in observations.images], []
    own = fit_at(observations.with_images(images), T_camera_lidar).information
    shares = core.shares_alike(core.nearest_ranges([cloud.points for cloud in observations.clouds]))
    for shift in range(1, observations.num_frames):
        others = images[shift:] + images[:shift]
        if np.diag(np.roll(shares, -shift, axis=1)).max() > MAX_SHARED:
            continue  # Images of one scene belong to all of its sweeps.
        alike = np.mean([np.mean(a.classes == b.classes) for a, b in zip(images, others, strict=True)])
        if alike <= MAX_ALIKE:
            exchanged.append(fit_at(observations.with_images(others), T_camera_lidar).information)
    if not exchanged:
        return []
    by, best = compared_by(observations), max(exchanged)
    sentence = f"clouds and images {NO_FIT}, and images of other frames fit better"
    if own > 0.0:
        as_well, most = format_against_limit(best / own, WRONG_PAIRING.limit(by), unit="%")
        sentence = f"images of other frames fit these sweeps {as_well} as well as their own (limit {most})"
    return [WRONG_PAIRING.measured(relative_information(best, own), sentence, by)]
