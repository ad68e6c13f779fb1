"""The calibration of a rig as a single page that needs no network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.errors import listed
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.rig.rig_calibration import WORST_FIRST, Pair, RigCalibration
from semcal_cli.many.rig.rig_document import cloud_path
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_points, read_frame_image
from semcal_cli.report.cloud import MAX_SEEN, CameraInView, Cloud, Rgb, make_cloud
from semcal_cli.report.colors import QUALITATIVE_COLORS, Legend, hex_color
from semcal_cli.report.notations import Notation, T_notation, matrix_text
from semcal_cli.report.overlays import Overlays
from semcal_cli.report.page_images import MAX_BYTES, MAX_IMAGE_BYTES, data_uri
from semcal_cli.report.points import at_pixels, points_in_image, thinned
from semcal_cli.report.template import Reason, Verdict, linked, render_page
from semcal_cli.report.words import NOT_BELIEVED
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.uncertainty import intervals, widest
from semcal_cli.threads import thread_pool

STATUSES = {
    "failed": "failed",
    "not_trusted": "not trusted",
    "not_assessed": "not assessed",
    "trusted": "trusted",
}
"""Status of a camera in words, worst first."""
BY_CAMERA, BY_IMAGE = "camera that sees them", "images"
"""Meanings of the colours of points in the 3-D view."""


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
        InputError: a sweep or an image is missing or wrong.
    """
    progress("reading a frame of each camera")
    views = _camera_views(drives, {name: each.pose for name, each in found.cameras.items()})
    progress("drawing points on images")
    images, depths = _images(views)
    progress("writing the page")
    cloud = _rig_cloud(views)
    return render_page(
        "many/rig/page.html",
        ("report/cloud.js",),
        "many/rig/rig.css",
        given=given,
        verdict=rig_verdict(found),
        notices=found.notes,
        found=found,
        of_cameras=_statuses(found),
        statuses=STATUSES,
        linked=linked,
        how_sure=_how_sure,
        placed={camera.name: camera for camera in cloud.cameras},
        frames={view.name: view.drive.frames[0].points for view in views},
        images=images,
        depths=depths,
        T_notation=T_notation,
        pairs=found.pairs,
        pair_notation=_pair_notation,
        intervals=intervals,
        cloud=asdict(cloud),
    )


def rig_verdict(found: RigCalibration) -> Verdict:
    """State the verdict on a rig: whether all its cameras can be used, and which cannot."""
    statuses = _statuses(found)
    names = {status: [name for name, each in statuses.items() if each == status] for status in STATUSES}
    if found.status == "trusted":
        uncertainties = [each.believed_uncertainty for each in found.cameras.values()]
        known = [each.half_widths for each in uncertainties if each is not None]
        widths = [max(axis) for axis in zip(*known, strict=True)]
        sure = f"each is known to {widest(widths)} or better" if known else ""
        all_of_them = "Both" if len(statuses) == 2 else f"All {len(statuses)}"
        return Verdict("trusted", "The rig is trusted", f"{all_of_them} cameras are trusted.", sure)
    worst, is_failed = names[found.status], found.status == "failed"
    verb = "" if is_failed else "is " if len(worst) == 1 else "are "
    title = f"{len(worst)} of {len(statuses)} cameras {verb}{STATUSES[found.status]}"
    said = {
        "These can be used": names["trusted"],
        "The accuracy of these is unknown": names["not_assessed"],
        "Do not use these, for the reasons below": names["failed"] + names["not_trusted"],
    }
    sentence = " ".join(f"{words}: {listed(named)}." for words, named in said.items() if named)
    reasons = [Reason(f"{name}: {error}") for name, error in found.failures.items()]
    for name, each in found.cameras.items():
        reasons += [
            Reason(f"{name}: {reason}", address) for reason, address in linked(each.reasons, each.topics)
        ]
    return Verdict("fail" if is_failed else found.status, title, sentence, reasons=tuple(reasons))


def _statuses(found: RigCalibration) -> dict[str, str]:
    """List the status of each camera, worst first."""
    calibrated = sorted(found.cameras.items(), key=lambda item: WORST_FIRST.index(item[1].status))
    return dict.fromkeys(found.failures, "failed") | {name: each.status for name, each in calibrated}


def _how_sure(calibration: CalibrationDocument) -> str:
    """Describe how accurate the transform of a camera is."""
    if calibration.believed_uncertainty is not None:
        return f"95 % interval: {', '.join(intervals(calibration.believed_uncertainty.half_widths))}."
    return "Its error is unknown." if calibration.uncertainty is None else NOT_BELIEVED


def _pair_notation(pair: Pair) -> Notation:
    a, b = pair.a, pair.b
    meaning = f"p_{a} = T_{a}_{b} p_{b}: from {b} to {a}, metres"
    return Notation(f"T_{a}_{b}", meaning, matrix_text(pair.T_a_b))


@dataclass(frozen=True)
class _CameraView:
    """One frame of a camera, with its points."""

    name: str
    color: Rgb
    T_camera_lidar: Pose
    drive: Drive
    """Drive with this frame only."""
    observations: Observations
    """Points of the frame, without labels."""
    is_of_sweep: bool
    """Whether the frame has the sweep that the 3-D view shows."""


def _camera_views(drives: Mapping[str, Drive], poses: Mapping[str, Pose]) -> list[_CameraView]:
    """Read one frame of each camera with a pose: that of the sweep that most cameras share, or else its first."""
    sweeps = {
        name: [cloud_path(drives[name], frame.points) for frame in drives[name].frames] for name in poses
    }
    counts = Counter(sweep for found in sweeps.values() for sweep in dict.fromkeys(found))
    ((common, _),) = counts.most_common(1)
    views = []
    for number, (name, T) in enumerate(poses.items()):
        is_of_sweep = common in sweeps[name]
        frame = drives[name].frames[sweeps[name].index(common) if is_of_sweep else 0]
        drive = drives[name].model_copy(update={"frames": (frame,)})
        color = QUALITATIVE_COLORS[number % len(QUALITATIVE_COLORS)]
        views.append(_CameraView(name, color, T, drive, unrolled(load_points(drive), T), is_of_sweep))
    return views


def _images(views: list[_CameraView]) -> tuple[dict[str, str], dict[str, str]]:
    """Draw the points of each camera's frame, coloured by distance: data URIs, and the legend of distances."""
    max_bytes = min(MAX_BYTES, MAX_IMAGE_BYTES // len(views))

    def draw(view: _CameraView) -> tuple[str, Legend]:
        overlays = Overlays(view.drive, view.observations, {view.name: view.T_camera_lidar}, "depth")
        images, legend = overlays.draw(0)
        return data_uri(images[view.name], max_bytes), legend

    with thread_pool() as pool:
        drawn = list(pool.map(draw, views))
    legend = {name: hex_color(color) for _, found in drawn for name, color in found.items()}
    return {view.name: uri for view, (uri, _) in zip(views, drawn, strict=True)}, legend


def _rig_cloud(views: list[_CameraView]) -> Cloud:
    """Colour the points of the sweep by the camera that sees them, and by the cameras' images."""
    shown = next(view for view in views if view.is_of_sweep)
    points = shown.observations.clouds[0].points
    is_seen = np.zeros(len(points), np.bool_)
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {BY_CAMERA: [], BY_IMAGE: []}
    # Where views overlap, points belong to the first camera: its colours are set last.
    for view in reversed(views):
        # Each camera sees the sweep at the moment of its own image.
        own = view.observations.clouds[0].points if view.is_of_sweep else points
        seen = points_in_image(own, view.T_camera_lidar, view.observations.camera)
        is_seen[seen.indices[~seen.is_hidden]] = True
        chosen = thinned(~seen.is_hidden, MAX_SEEN // len(views))
        indices = seen.indices[chosen]
        found[BY_CAMERA].append((indices, np.full((len(indices), 3), view.color, np.uint8)))
        image = read_frame_image(view.drive, view.drive.frames[0]) if view.is_of_sweep else None
        if image is not None:
            found[BY_IMAGE].append((indices, at_pixels(image, seen.pixels[chosen])[:, ::-1]))
    colored = {
        name: (np.concatenate([i for i, _ in parts]), np.concatenate([rgb for _, rgb in parts]))
        for name, parts in found.items()
        if parts
    }
    cameras = [
        CameraInView.placed(view.name, view.color, view.observations.camera, view.T_camera_lidar)
        for view in views
    ]
    return make_cloud(shown.drive.frames[0].points, points, is_seen, colored, cameras)
