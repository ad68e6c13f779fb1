"""The pages about a calibration and about a verification."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.checks import precedence
from semcal_cli.config import LABELS
from semcal_cli.estimation.adjust.frame_offsets import FrameOffsets, frame_offsets
from semcal_cli.files.documents import FORMATS, document_text
from semcal_cli.files.output_files import write_text
from semcal_cli.geometry.poses import camera_center, compare_poses
from semcal_cli.observations.cues.cue_table import files_of
from semcal_cli.observations.frame_naming import frame_names
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.pipeline.verdict import overall_offsets
from semcal_cli.report import words
from semcal_cli.report.cloud import frame_cloud
from semcal_cli.report.colors import PageColors, first_coloring
from semcal_cli.report.drawing import Plot
from semcal_cli.report.figures import (
    class_agreements,
    curve_plots,
    frame_pixels,
    frames_plots,
    information_curves,
    pixels_plot,
)
from semcal_cli.report.image_maps import map_plots
from semcal_cli.report.input import ReportInput
from semcal_cli.report.notations import T_notation, files, notations
from semcal_cli.report.overlays import Overlays, image_of
from semcal_cli.report.page_images import MAX_FRAMES, FrameImage, FrameImages, make_images
from semcal_cli.report.points import View
from semcal_cli.report.template import PageVerdict, link_reasons, render_page
from semcal_cli.result.applied import apply_result, seen_as
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.next_steps import Rows, after_calibration
from semcal_cli.result.provenance import hash_input, versions
from semcal_cli.result.refined_camera import intrinsic_texts
from semcal_cli.result.sections import DrivePart
from semcal_cli.result.uncertainty import CHECK_NAMES

if TYPE_CHECKING:
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.observations.loading import LoadedDrive
    from semcal_cli.pipeline.verification import Verification

SCRIPTS = tuple(f"report/{name}.js" for name in ("image", "images", "cloud"))
TITLES = {"pass": "Pass", "fail": "Fail", "inconclusive": "Inconclusive"}
ESTIMATED = "found on this drive"
"""Caption of the pose that a verification estimates."""
REACH, MAX_REACH = 1.25, 6.0
"""Reach of the bars to either side, relative to the farthest offset, and its limit, relative to the allowed offset."""


def write_report(
    report: ReportInput, path: Path, progress: Callable[[str], None] = lambda step: None
) -> None:
    """Write the page about a calibration.

    Args:
        report: Transform and frames that the page shows.
        path: HTML file to write.
        progress: Called with a description of each step.

    Raises:
        InputError: an image is missing or wrong, or the file cannot be written. An existing file then stays unchanged.
    """
    observations, T, record = report.observations, report.T_camera_lidar, report.record
    agreement, before = core.agreement(observations.core, T), None
    if report.before is not None:
        before = View(report.observed_by(report.before.drive), report.before.T_camera_lidar).agreement()
    drawings = _draw_content(report, progress)
    progress("writing the page")
    made_by, options, hashes = versions(), "", {}
    if record is None:
        hashes = hash_input(report.drive, files_of(LABELS))
    else:
        made_by, hashes = record.settings.versions, record.input.sha256
        options = document_text(record.settings.options, "yaml")
    page = render_page(
        "report/page.html",
        SCRIPTS,
        version=made_by.get("semcal", ""),
        words=words,
        report=report,
        record=record,
        verdict=words.verdict(report),
        notices=(*report.notices, *(record.notes if record else ())),
        agreement=agreement,
        turn_loss=observations.turn_loss(T),
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        notations=notations(T),
        files=files(T, record.used_camera if record and record.camera else None, report.drive.frame_ids),
        classes=class_agreements(observations, agreement, before),
        frame_names=frame_names([frame.points for frame in report.drive.frames]),
        frames_plots=frames_plots,
        pixels_plot=pixels_plot,
        intrinsics=[]
        if record is None or record.camera is None
        else intrinsic_texts(record.camera, is_trusted=record.is_believed),
        error_of=lambda stage: compare_poses(np.array(stage.T_camera_lidar), T),
        reach=_reach_of_hypotheses(record) if record else None,
        options=options,
        next_steps=_next_steps(report),
        versions=made_by,
        hashes=hashes,
        **drawings,
    )
    write_text(page, path)


def _next_steps(report: ReportInput) -> Rows:
    """List what to do with a calibration; empty for another file, or on other frames."""
    if report.record is None or not report.is_of_record or Path(report.name).suffix not in FORMATS:
        return []
    return after_calibration(report.record, Path(report.name), precedence.leading(report.record.topics))


def _draw_content(report: ReportInput, progress: Callable[[str], None]) -> dict[str, Any]:
    """Draw what the page shows, by the names of its template."""
    observations, T, record, parts = report.observations, report.T_camera_lidar, report.record, _parts(report)
    # Python code runs while other work is in the core or in an encoder.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(import_module, "matplotlib.figure")
        progress("drawing points on images")
        images = make_images(report.overlays(MAX_FRAMES))
        progress("computing the mutual information along six axes")
        maps = pool.submit(_map_errors, report)
        curves = information_curves(observations, T, record.believed_uncertainty if record else None)
        plots = pool.submit(curve_plots, curves)
        cloud = pool.submit(frame_cloud, report)
        progress("calibrating each frame on its own")
        offsets: FrameOffsets | None = None
        if observations.num_frames > 1 and not observations.has_vectors:
            offsets = frame_offsets(observations, T, parts)
    pixels = None
    if offsets is not None and offsets.is_determined.any():
        pixels = frame_pixels(observations, T, offsets)
    return {
        "images": images,
        "maps": maps.result(),
        "plots": plots.result(),
        "cloud": asdict(cloud.result()),
        "of_frames": offsets,
        "pixels_of_frames": None if pixels is None or np.isnan(pixels).all() else pixels,
        "num_parts": len(parts),
    }


def _map_errors(report: ReportInput) -> list[Plot]:
    """Map the interval over the image, on the photograph of the first frame; empty without an interval."""
    record = report.record
    if record is None or record.believed_uncertainty is None:
        return []
    camera = record.used_camera
    maps = [each for each in record.believed_uncertainty.pixel_maps(camera) if not each.is_empty]
    if not maps:
        return []
    image, is_photograph = image_of(report.drive, report.observations, 0)
    is_behind = is_photograph and camera.size == report.observations.camera.size
    return map_plots(maps, image if is_behind else None)


def _parts(report: ReportInput) -> tuple[DrivePart, ...]:
    """Return the parts of the drive with their own poses, if the calibration was computed from the frames shown."""
    parts = () if report.record is None or not report.is_of_record else report.record.parts
    is_whole = sum(part.num_frames for part in parts) == report.observations.num_frames
    return parts if is_whole else ()


def _reach_of_hypotheses(record: CalibrationDocument) -> tuple[float, float]:
    """Return the range of the information of mountings minus its bias, with one standard error to either side."""
    hypotheses = [
        (hypothesis.mutual_information_nats - hypothesis.bias_nats, hypothesis.sigma_nats or 0.0)
        for hypothesis in record.hypotheses
    ]
    low = min((nats - sigma for nats, sigma in hypotheses), default=0.0)
    high = max((nats + sigma for nats, sigma in hypotheses), default=1.0)
    return low, high


def both_overlays(verification: Verification, data: LoadedDrive, initial_pose: InitialPose) -> Overlays:
    """Put the verified transform and the one that was found side by side, on evenly spaced frames."""
    sample = data.of_frames(evenly_spaced(range(len(data.drive.frames)), MAX_FRAMES))
    sample = sample.along_scans(verification.T_camera_lidar)
    poses = {initial_pose.name: initial_pose.T_camera_lidar, ESTIMATED: verification.T_camera_lidar}
    estimated_drive = sample.drive.model_copy(update={"time_offset_s": verification.time_offset_s})
    observations = {ESTIMATED: seen_as(sample.first_cue, sample.drive, estimated_drive)}
    by = first_coloring(sample.first_cue)
    by = "agreement" if by == "class" else by
    return Overlays(sample.drive, sample.first_cue, poses, by, observations)


class DrivePicture(NamedTuple):
    """A frame of one of several drives on a page, with the points at the verified and at the found pose."""

    drive: str
    """Name of the drive."""
    images: FrameImages
    image: FrameImage


def draw_verification(
    verification: Verification, data: LoadedDrive, initial_pose: InitialPose, drive: str, number: int
) -> DrivePicture:
    """Draw the first frame of a drive, for a page about several drives.

    Args:
        verification: The pose that was found.
        data: The drive.
        initial_pose: The transform that was verified.
        drive: Name of the drive.
        number: Number of the frame on the page.

    Raises:
        InputError: its image is missing or wrong.
    """
    images = make_images(both_overlays(verification, data, initial_pose))
    return DrivePicture(drive, images, replace(images.best, number=number))


def common_colors(pictures: Sequence[DrivePicture]) -> PageColors:
    """Keep the colours that mean the same on all pictures: those of classes differ where drives have other classes."""
    first, *others = [picture.images.colors for picture in pictures]
    names = [
        name for name, table in first.tables.items() if all(table == each.tables.get(name) for each in others)
    ]
    legends = {name: dict(ChainMap(*(each.legends[name] for each in (first, *others)))) for name in names}
    return PageColors({name: first.tables[name] for name in names}, legends)


def write_verification(
    verification: Verification,
    data: LoadedDrive,
    initial_pose: InitialPose,
    path: Path,
    given: Path | None = None,
) -> None:
    """Write the page about a verification: the verdict axis by axis, and both transforms on the images.

    Args:
        verification: Verdict, checks, and the pose that was found.
        data: The drive that it was found on.
        initial_pose: The transform that was verified.
        path: HTML file to write.
        given: What the drive was made of, to name in its place; None names the drive.

    Raises:
        InputError: an image is missing or wrong, or the file cannot be written. An existing file then stays unchanged.
    """
    name, record = initial_pose.name, initial_pose.record
    applied = apply_result(record, data.drive, name)
    camera = []
    if record is not None and record.has_found_camera and "camera" not in dict(applied.changes):
        camera = [f"The camera is that of {name}, estimated together with the transform."]
    farthest = max(
        (abs(check.offset) + (check.half_width or 0.0)) / check.allowed for check in verification.checks
    )
    page = render_page(
        "report/verification.html",
        ("report/image.js", "report/images.js"),
        verdict=PageVerdict(
            verification.verdict,
            TITLES[verification.verdict],
            verification.sentence,
            "" if verification.is_reasoned else "; ".join(overall_offsets(verification.checks)),
            link_reasons(verification.reasons, verification.topics),
        ),
        notices=(*camera, *applied.sentences, *verification.notes),
        name=name,
        drive=data.drive,
        given=given or data.drive.path,
        verification=verification,
        checks=verification.checks,
        check_names=CHECK_NAMES,
        reach=min(REACH * max(1.0, farthest), MAX_REACH),
        images=make_images(both_overlays(verification, data, initial_pose)),
        verified=T_notation(initial_pose.T_camera_lidar),
        found=T_notation(verification.T_camera_lidar),
    )
    write_text(page, path)
