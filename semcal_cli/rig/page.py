"""The calibration of a rig as one page that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from semcal_cli.drive.document import Drive
from semcal_cli.files.messages import listed
from semcal_cli.geometry.poses import camera_center
from semcal_cli.report.colors import Legend, hex_color
from semcal_cli.report.notations import Notation, matrix_text, notations
from semcal_cli.report.overlay import Overlays
from semcal_cli.report.pictures import MAX_BYTES, MAX_PICTURE_BYTES, data_uri
from semcal_cli.report.template import ENVIRONMENT, source
from semcal_cli.report.words import NOT_BELIEVED, Reason, Verdict, linked
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.intervals import intervals, widest
from semcal_cli.result.provenance import versions
from semcal_cli.rig.calibration import WORST_FIRST, RigCalibration
from semcal_cli.rig.cloud import CameraView, camera_views, rig_cloud
from semcal_cli.rig.pairs import Pair
from semcal_cli.threads import thread_pool

FOLDER = Path(__file__).parent
STATUSES = {
    "failed": "failed",
    "not_trusted": "not trusted",
    "not_assessed": "not assessed",
    "trusted": "trusted",
}
"""Status of a camera in words, the worst first."""
MAX_PAIRS = 300
"""Largest number of pairs that the page shows; the result file has all."""


@dataclass(frozen=True)
class CameraCard:
    """What the page shows of one camera."""

    name: str
    color: str | None
    """Its colour in the 3-D view; None for a camera without a transform."""
    status: str
    reasons: tuple[Reason, ...]
    sure: str
    """How sure its transform is, in words."""
    center: list[float] | None
    """Its place in the LiDAR frame, metres."""
    notation: Notation | None
    picture: str | None
    """Its points on one picture, as a data URI."""
    frame: str


@dataclass(frozen=True)
class PairCard:
    """What the page shows of two cameras."""

    notation: Notation
    intervals: tuple[str, ...]
    reference: str
    """How far it is from its reference; empty without one."""
    is_explained: bool | None


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
    return ENVIRONMENT.get_template("rig/page.html").render(
        style=source("page.css"),
        own_style=Markup((FOLDER / "rig.css").read_text()),
        script=Markup("\n").join([source("copy.js", "cloud.js"), Markup((FOLDER / "page.js").read_text())]),
        version=versions()["semcal"],
        given=given,
        verdict=rig_verdict(found),
        notices=found.notes,
        found=found,
        cameras=_camera_cards(found, views, pictures),
        statuses=STATUSES,
        legend=legend,
        pairs=[_pair_card(pair) for pair in found.pairs[:MAX_PAIRS]],
        cloud=rig_cloud(views),
    )


def rig_verdict(found: RigCalibration) -> Verdict:
    """State the verdict on a rig: whether all its cameras may be used, and which may not."""
    num_cameras = len(found.cameras) + len(found.failures)
    names = {
        status: [name for name, each in _statuses(found).items() if each == status] for status in STATUSES
    }
    worst = names[found.status]
    if found.status == "trusted":
        known = [
            each.believed_uncertainty.half_widths
            for each in found.cameras.values()
            if each.believed_uncertainty is not None
        ]
        widths = [max(axis) for axis in zip(*known, strict=True)]
        sure = f"each is known to {widest(widths)}, or better" if known else ""
        all_of_them = "Both" if num_cameras == 2 else f"All {num_cameras}"
        return Verdict("trusted", "The rig is trusted", f"{all_of_them} cameras are trusted.", sure)
    verb = "is " if len(worst) == 1 else "are "
    title = f"{len(worst)} of {num_cameras} cameras {'' if found.status == 'failed' else verb}{STATUSES[found.status]}"
    sentences = []
    if names["trusted"]:
        sentences.append(f"These can be used: {listed(names['trusted'])}.")
    if names["not_assessed"]:
        sentences.append(f"Nothing tells how sure these are: {listed(names['not_assessed'])}.")
    if bad := names["failed"] + names["not_trusted"]:
        sentences.append(f"Do not use these, for the reasons below: {listed(bad)}.")
    status = "fail" if found.status == "failed" else found.status
    return Verdict(status, title, " ".join(sentences), reasons=_reasons(found))


def _reasons(found: RigCalibration) -> tuple[Reason, ...]:
    """Errors and findings of all cameras, as `RigCalibration.reasons`."""
    return (
        *(Reason(f"{name}: {reason}") for name, reason in found.failures.items()),
        *(
            Reason(f"{name}: {reason.sentence}", reason.address)
            for name, each in found.cameras.items()
            for reason in linked(each.reasons, each.topics)
        ),
    )


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


def _camera_cards(
    found: RigCalibration, views: list[CameraView], pictures: Mapping[str, str]
) -> list[CameraCard]:
    of_name = {view.name: view for view in views}
    return [
        _failed_card(name, found.failures[name])
        if status == "failed"
        else _camera_card(found.cameras[name], of_name[name], pictures[name])
        for name, status in _statuses(found).items()
    ]


def _failed_card(name: str, reason: str) -> CameraCard:
    return CameraCard(name, None, "failed", (Reason(reason),), "There is no transform.", None, None, None, "")


def _camera_card(calibration: Calibration, view: CameraView, picture: str) -> CameraCard:
    sure = "Nothing is known of its error."
    if calibration.believed_uncertainty is not None:
        sure = f"95 % interval: {', '.join(intervals(calibration.believed_uncertainty.half_widths))}."
    elif calibration.uncertainty is not None:
        sure = NOT_BELIEVED
    return CameraCard(
        name=view.name,
        color="#{:02x}{:02x}{:02x}".format(*view.color),
        status=calibration.status,
        reasons=linked(calibration.reasons, calibration.topics),
        sure=sure,
        center=camera_center(view.T_camera_lidar).tolist(),
        notation=notations(view.T_camera_lidar)[0],
        picture=picture,
        frame=view.drive.frames[0].points,
    )


def _pair_card(pair: Pair) -> PairCard:
    a, b = pair.a, pair.b
    notation = Notation(
        f"T_{a}_{b}", f"p_{a} = T_{a}_{b} p_{b}: from {b} to {a}, metres", matrix_text(pair.T_a_b)
    )
    reference = ""
    if pair.reference is not None and pair.error is not None:
        words = {None: "", True: ", within the uncertainty", False: ", more than chance explains"}
        reference = (
            f"{10.0 * pair.error.camera_center_cm:.1f} mm and {pair.error.rotation_deg:.3f} degrees from "
            f"{pair.reference.source}{words[pair.is_explained]}"
        )
    believed = pair.believed_uncertainty
    known = () if believed is None else intervals(believed.half_widths)
    return PairCard(notation, known, reference, pair.is_explained)
