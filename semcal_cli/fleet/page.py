"""A fleet as one page that needs no network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

from semcal_cli.config import Limits
from semcal_cli.fleet.fleet import ComparedDrive, Fleet
from semcal_cli.fleet.plot import plot_fleet
from semcal_cli.geometry.poses import camera_center
from semcal_cli.report.notations import notations
from semcal_cli.report.template import ENVIRONMENT, source
from semcal_cli.report.words import Verdict
from semcal_cli.result.provenance import versions

TITLES = {
    "pass": "The rig holds",
    "fail": "The rig does not hold",
    "inconclusive": "The drives cannot decide",
}
SENTENCES = {
    "pass": "No change, no drift and no drive is beyond what is allowed.",
    "fail": "Something is surely beyond what is allowed.",
    "inconclusive": "Nothing is surely beyond what is allowed, and not all is surely within.",
}


@dataclass(frozen=True)
class DriveRow:
    """A row of the table of drives, as text."""

    drive: str
    time: str
    center: str
    center_half: str
    rotation: str
    rotation_half: str
    verdict: str


def page_html(fleet: Fleet, given: Sequence[str]) -> str:
    """Make the page.

    Args:
        fleet: Combined result that the page shows.
        given: Names of the inputs that it was computed from.
    """
    known, scatter = fleet.parts[-1].half_widths, fleet.scatter
    return ENVIRONMENT.get_template("fleet/page.html").render(
        style=source("page.css"),
        script=source("copy.js"),
        version=versions()["semcal"],
        fleet=fleet,
        given=given,
        verdict=Verdict(
            fleet.verdict, TITLES[fleet.verdict], SENTENCES[fleet.verdict], reasons=fleet.reasons
        ),
        notices=fleet.notes,
        camera_center=camera_center(fleet.T_camera_lidar).tolist(),
        known_cm=(100.0 * known[:3]).tolist(),
        known_deg=known[3:].tolist(),
        scatter_cm=(100.0 * scatter[:3]).tolist(),
        scatter_deg=scatter[3:].tolist(),
        plot=base64.b64encode(plot_fleet(fleet, "svg")).decode(),
        notations=notations(fleet.T_camera_lidar),
        rows=[_row(drive, fleet.limits) for drive in fleet.drives],
    )


def _row(compared: ComparedDrive, limits: Limits) -> DriveRow:
    center, rotation = (check for check in compared.offset.judge(limits) if check.name.endswith("in all"))
    assert center.half_width is not None
    assert rotation.half_width is not None
    beyond = "farther off than is allowed" if compared.is_far else ""
    surely = "surely " if compared.verdict == "fail" else ""
    return DriveRow(
        drive=compared.member.drive,
        time=f"{compared.time:g}",
        center=f"{center.offset:.3f}",
        center_half=f"{center.half_width:.3f}",
        rotation=f"{rotation.offset:.4f}",
        rotation_half=f"{rotation.half_width:.4f}",
        verdict=surely + beyond or ("disagrees, within what is allowed" if compared.disagrees else "agrees"),
    )
