"""A fleet as a single page that needs no network."""

from __future__ import annotations

from semcal_cli.fleet import fleet_verdict as words
from semcal_cli.fleet.fleet_result import Fleet
from semcal_cli.fleet.timeline import DriveKind, kind_of, make_timeline, timeline_plots
from semcal_cli.geometry.poses import camera_center
from semcal_cli.pipeline.verdict import VERDICTS
from semcal_cli.report.notations import notations
from semcal_cli.report.template import PageVerdict, link_reasons, render_page
from semcal_cli.result.uncertainty import intervals, widest

KINDS: dict[DriveKind, str] = {
    "beyond": "drive clearly beyond the limits",
    "disagrees": "drive that disagrees or is possibly beyond the limits",
    "agrees": "drive",
}
"""Meaning of the dots, worst first."""
MAX_ROWS = 1000
"""Largest number of rows of a table; the result file has all."""
MAX_PARTS = 100
"""Largest number of parts of the history that the page shows; the last ones are kept."""


def page_html(fleet: Fleet, inputs: str) -> str:
    """Make the page.

    Args:
        fleet: The combined result.
        inputs: Names of the inputs that it was computed from.
    """
    timeline, scatter = make_timeline(fleet), intervals(fleet.scatter.tolist())
    half_widths = fleet.parts[-1].half_widths.tolist()
    checks = sorted(fleet.checks, key=lambda check: VERDICTS.index(check.verdict))
    drives = sorted(enumerate(fleet.drives, start=1), key=lambda drive: list(KINDS).index(kind_of(drive[1])))
    return render_page(
        "fleet/page.html",
        style="fleet/fleet.css",
        words=words,
        fleet=fleet,
        inputs=inputs,
        verdict=PageVerdict(
            fleet.verdict,
            words.title(fleet),
            " ".join(words.sentences(fleet)),
            f"known to {widest(half_widths)}",
            reasons=link_reasons(fleet.reasons),
        ),
        notices=fleet.notes,
        camera_center=camera_center(fleet.T_camera_lidar).tolist(),
        intervals=intervals,
        known=intervals(half_widths),
        scatter=scatter,
        is_scattered=bool(fleet.scatter.round(4).any()),  # from 0.1 mm on
        timeline=timeline,
        plots=timeline_plots(timeline),
        kinds=KINDS,
        kind_of=kind_of,
        notations=notations(fleet.T_camera_lidar),
        parts=fleet.parts[-MAX_PARTS:],
        checks=checks[:MAX_ROWS],
        drives=drives[:MAX_ROWS],
        left_out=[
            (drive.name, *link_reasons([drive.left_out or ""], [drive.topic] if drive.topic else ()))
            for drive in fleet.left_out[:MAX_ROWS]
        ],
        max_rows=MAX_ROWS,
    )
