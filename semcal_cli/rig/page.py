"""The calibration of a rig as one page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

from semcal_cli.drive.document import Drive
from semcal_cli.errors import listed
from semcal_cli.report.colors import Legend, hex_color
from semcal_cli.report.notations import Notation, T_notation, matrix_text
from semcal_cli.report.overlay import Overlays
from semcal_cli.report.pictures import MAX_BYTES, MAX_PICTURE_BYTES, data_uri
from semcal_cli.report.template import Reason, Verdict, linked, render_page
from semcal_cli.report.words import NOT_BELIEVED
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.intervals import intervals, widest
from semcal_cli.rig.calibration import WORST_FIRST, RigCalibration
from semcal_cli.rig.cloud import CameraView, camera_views, rig_cloud
from semcal_cli.rig.pairs import Pair
from semcal_cli.threads import thread_pool

STATUSES = {
    "failed": "failed",
    "not_trusted": "not trusted",
    "not_assessed": "not assessed",
    "trusted": "trusted",
}
"""Status of a camera in words, the worst first."""
MAX_PAIRS = 300
"""Largest number of pairs that the page shows; the result file has all."""


def rig_page_html(
    found: RigCalibration,
    drives: Mapping[str, Drive],
    given: tuple[str, str],
    progress: Callable[[str], None] = lambda doing: None,
) -> str:
    """Make the page.

    Args:
        found: Calibration of the rig.
        drives: Drive of each camera.
        given: Names of the rig and of the result.
        progress: Called with a description of each step.

    Raises:
        InputError: a sweep or a picture is missing or wrong.
    """
    progress("reading a frame of each camera")
    views = camera_views(drives, {name: each.pose for name, each in found.cameras.items()})
    progress("drawing points on pictures")
    pictures, legend = _pictures(views)
    progress("writing the page")
    cloud = rig_cloud(views)
    return render_page(
        "rig/page.html",
        ("report/cloud.js", "rig/page.js"),
        "rig/rig.css",
        given=given,
        verdict=rig_verdict(found),
        notices=found.notes,
        found=found,
        of_cameras=_statuses(found),
        statuses=STATUSES,
        linked=linked,
        how_sure=how_sure,
        placed={camera.name: camera for camera in cloud.cameras},
        frames={view.name: view.drive.frames[0].points for view in views},
        pictures=pictures,
        legend=legend,
        T_notation=T_notation,
        pairs=found.pairs[:MAX_PAIRS],
        pair_notation=_pair_notation,
        intervals=intervals,
        cloud=asdict(cloud),
    )


def rig_verdict(found: RigCalibration) -> Verdict:
    """State the verdict on a rig: whether all its cameras may be used, and which may not."""
    statuses = _statuses(found)
    names = {status: [name for name, each in statuses.items() if each == status] for status in STATUSES}
    if found.status == "trusted":
        uncertainties = [each.believed_uncertainty for each in found.cameras.values()]
        known = [each.half_widths for each in uncertainties if each is not None]
        widths = [max(axis) for axis in zip(*known, strict=True)]
        sure = f"each is known to {widest(widths)}, or better" if known else ""
        all_of_them = "Both" if len(statuses) == 2 else f"All {len(statuses)}"
        return Verdict("trusted", "The rig is trusted", f"{all_of_them} cameras are trusted.", sure)
    worst, is_failed = names[found.status], found.status == "failed"
    verb = "" if is_failed else "is " if len(worst) == 1 else "are "
    title = f"{len(worst)} of {len(statuses)} cameras {verb}{STATUSES[found.status]}"
    said: dict[str, Sequence[str]] = {
        "These can be used": names["trusted"],
        "Nothing tells how sure these are": names["not_assessed"],
        "Do not use these, for the reasons below": names["failed"] + names["not_trusted"],
    }
    sentence = " ".join(f"{words}: {listed(named)}." for words, named in said.items() if named)
    return Verdict("fail" if is_failed else found.status, title, sentence, reasons=_reasons(found))


def _reasons(found: RigCalibration) -> tuple[Reason, ...]:
    """Errors and findings of all cameras, as `RigCalibration.reasons`."""
    addresses: list[str | None] = [None] * len(found.failures)
    for each in found.cameras.values():
        addresses += [reason.address for reason in linked(each.reasons, each.topics)]
    return tuple(map(Reason, found.reasons, addresses))


def _statuses(found: RigCalibration) -> dict[str, str]:
    """Status of each camera, the worst first."""
    calibrated = sorted(found.cameras.items(), key=lambda item: WORST_FIRST.index(item[1].status))
    return dict.fromkeys(found.failures, "failed") | {name: each.status for name, each in calibrated}


def _pictures(views: list[CameraView]) -> tuple[dict[str, str], dict[str, str]]:
    """Draw the points of each camera's frame by their distance: data URIs, and the colours of distances."""
    max_bytes = min(MAX_BYTES, MAX_PICTURE_BYTES // len(views))

    def draw(view: CameraView) -> tuple[str, Legend]:
        overlays = Overlays(view.drive, view.observations, {view.name: view.T_camera_lidar}, "depth")
        images, legend = overlays.draw(0)
        return data_uri(images[view.name], max_bytes), legend

    with thread_pool() as pool:
        drawn = list(pool.map(draw, views))
    legend = {name: hex_color(color) for _, found in drawn for name, color in found.items()}
    return {view.name: uri for view, (uri, _) in zip(views, drawn, strict=True)}, legend


def how_sure(calibration: Calibration) -> str:
    """Say how sure the transform of a camera is."""
    if calibration.believed_uncertainty is not None:
        return f"95 % interval: {', '.join(intervals(calibration.believed_uncertainty.half_widths))}."
    return "Nothing is known of its error." if calibration.uncertainty is None else NOT_BELIEVED


def _pair_notation(pair: Pair) -> Notation:
    a, b = pair.a, pair.b
    meaning = f"p_{a} = T_{a}_{b} p_{b}: from {b} to {a}, metres"
    return Notation(f"T_{a}_{b}", meaning, matrix_text(pair.T_a_b))
