"""The calibration of a rig as a single page that needs no network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction

from semcal_cli.drive.document import Drive
from semcal_cli.errors import listed
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.rig.rig_calibration import WORST_FIRST, RigCalibration
from semcal_cli.many.rig.shared_clouds import cloud_path
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.reading import load_points
from semcal_cli.report import words
from semcal_cli.report.cloud import SweepView, sweep_cloud
from semcal_cli.report.overlays import Overlays
from semcal_cli.report.page_images import overlay_uri
from semcal_cli.report.template import PageVerdict, link_reasons, render_page
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


def rig_page_html(
    rig: RigCalibration,
    drives: Mapping[str, Drive],
    names: tuple[str, str],
    progress: Callable[[str], None] = lambda doing: None,
) -> str:
    """Make the page.

    Args:
        rig: Calibration of the rig.
        drives: Drive of each camera.
        names: Names of the rig and of the result.
        progress: Called with a description of each step.

    Raises:
        InputError: a sweep or an image is missing or wrong.
    """
    progress("reading a frame of each camera")
    around = _around_one_lidar(rig)
    views = _camera_views(
        drives, {name: calibration.pose for name, calibration in rig.cameras.items()}, around
    )
    progress("drawing points on images")
    images, depths = _images(views)
    progress("writing the page")
    cloud = sweep_cloud([view for view in views if view.name in around])
    return render_page(
        "many/rig/page.html",
        ("report/cloud.js",),
        "many/rig/rig.css",
        names=names,
        verdict=rig_verdict(rig),
        notices=rig.notes,
        rig=rig,
        of_cameras=_statuses(rig),
        statuses=STATUSES,
        link_reasons=link_reasons,
        how_sure=_how_sure,
        placed={camera.name: camera for camera in cloud.cameras},
        frames={view.name: view.drive.frames[0].points for view in views},
        images=images,
        depths=depths,
        pairs=rig.pairs,
        cloud=asdict(cloud),
    )


def rig_verdict(rig: RigCalibration) -> PageVerdict:
    """State the verdict on a rig: whether all its cameras can be used, and which cannot."""
    statuses = _statuses(rig)
    names = {
        status: [name for name, its_status in statuses.items() if its_status == status] for status in STATUSES
    }
    if rig.status == "trusted":
        uncertainties = [calibration.believed_uncertainty for calibration in rig.cameras.values()]
        half_widths = [uncertainty.half_widths for uncertainty in uncertainties if uncertainty is not None]
        widths = [max(axis) for axis in zip(*half_widths, strict=True)]
        sure = f"each is known to {widest(widths)} or better" if half_widths else ""
        all_of_them = "Both" if len(statuses) == 2 else f"All {len(statuses)}"
        sensors = f"calibrations of {len(rig.lidars) + 1} LiDARs" if rig.lidars else "cameras"
        return PageVerdict("trusted", "The rig is trusted", f"{all_of_them} {sensors} are trusted.", sure)
    worst, is_failed = names[rig.status], rig.status == "failed"
    if not worst:
        title = "The cameras contradict a constraint"
        if rig.lidars:
            tied = "The LiDARs are not tied well"
            title = "Measurements of the rig contradict each other" if rig.contradictions else tied
        if rig.contradicted_images and not rig.contradictions:
            title = "The cameras contradict their images"
        sentence = "Each camera is trusted alone."
        if unknown := names["not_assessed"]:
            sentence = f"The accuracy of these is unknown: {listed(unknown)}."
        return PageVerdict(rig.status, title, sentence, reasons=tuple(link_reasons(rig.doubts)))
    verb = "" if is_failed else "is " if len(worst) == 1 else "are "
    kind = "calibrations" if rig.lidars else "cameras"
    title = f"{len(worst)} of {len(statuses)} {kind} {verb}{STATUSES[rig.status]}"
    groups = {
        "These can be used": names["trusted"],
        "The accuracy of these is unknown": names["not_assessed"],
        "Do not use these, for the reasons below": names["failed"] + names["not_trusted"],
    }
    sentence = " ".join(f"{advice}: {listed(members)}." for advice, members in groups.items() if members)
    reasons = list(link_reasons(rig.doubts))
    reasons += link_reasons([f"{name}: {error}" for name, error in rig.failures.items()])
    for name, calibration in rig.cameras.items():
        reasons += link_reasons(calibration.reasons, calibration.topics, f"{name}: ")
    return PageVerdict("fail" if is_failed else rig.status, title, sentence, reasons=tuple(reasons))


def _statuses(rig: RigCalibration) -> dict[str, str]:
    """List the status of each camera, worst first."""
    calibrated = sorted(rig.cameras.items(), key=lambda item: WORST_FIRST.index(item[1].status))
    return dict.fromkeys(rig.failures, "failed") | {
        name: calibration.status for name, calibration in calibrated
    }


def _how_sure(calibration: CalibrationDocument) -> str:
    """Describe how accurate the transform of a camera is."""
    if calibration.believed_uncertainty is not None:
        return f"95 % interval: {', '.join(intervals(calibration.believed_uncertainty.half_widths))}."
    return "Its error is unknown." if calibration.uncertainty is None else words.NOT_BELIEVED


def _around_one_lidar(rig: RigCalibration) -> list[str]:
    """Select the calibrations of one LiDAR, the first one that has any, as only their poses are in one frame."""
    lidar_views = ([*rig.first_cameras], *([*lidar.views.values()] for lidar in rig.lidars))
    return next(names for names in ([*filter(rig.cameras.get, views)] for views in lidar_views) if names)


def _camera_views(
    drives: Mapping[str, Drive], poses: Mapping[str, Pose], around: Sequence[str]
) -> list[SweepView]:
    """Read one frame of each camera with a pose: that of the sweep that most cameras around share, or else its first.

    Args:
        drives: Drive of each camera.
        poses: T_camera_lidar (4, 4) of each.
        around: The cameras of one LiDAR.
    """
    sweeps = {
        name: [cloud_path(drives[name], frame.points) for frame in drives[name].frames] for name in poses
    }
    counts = Counter(sweep for name in around for sweep in dict.fromkeys(sweeps[name]))
    ((shared_sweep, _),) = counts.most_common(1)
    views = []
    for name, T in poses.items():
        is_of_sweep = shared_sweep in sweeps[name]
        frame = drives[name].frames[sweeps[name].index(shared_sweep) if is_of_sweep else 0]
        drive = drives[name].model_copy(update={"frames": (frame,)})
        views.append(SweepView(name, T, drive, unrolled(load_points(drive), T), is_of_sweep))
    return views


def _images(views: list[SweepView]) -> tuple[dict[str, str], dict[str, str]]:
    """Draw the points of each camera's frame, coloured by distance: data URIs, and the legend of distances."""

    def draw(view: SweepView) -> tuple[str, dict[str, str]]:
        overlays = Overlays(view.drive, view.observations, {view.name: view.T_camera_lidar}, "depth")
        return overlay_uri(overlays, Fraction(1, len(views)))

    with thread_pool() as pool:
        drawings = list(pool.map(draw, views))
    legend = {name: color for _, colors in drawings for name, color in colors.items()}
    return {view.name: uri for view, (uri, _) in zip(views, drawings, strict=True)}, legend
