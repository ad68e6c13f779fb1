"""The report page: the template filled with all figures, images, style and script."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli import _core
from semcal_cli.assessment.frame_offsets import FrameOffsets, frame_offsets
from semcal_cli.assessment.pairing import frame_names
from semcal_cli.config import LABELS
from semcal_cli.drive.cues.table import files_of
from semcal_cli.drive.motion import unrolled
from semcal_cli.files.documents import document_text
from semcal_cli.files.writing import write_text
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import camera_center
from semcal_cli.report import words
from semcal_cli.report.classes import class_agreements
from semcal_cli.report.cloud import frame_cloud
from semcal_cli.report.curves import information_curves
from semcal_cli.report.input import ReportInput
from semcal_cli.report.notations import files, notations
from semcal_cli.report.pictures import MAX_BYTES, MAX_FRAMES, data_uri, make_pictures
from semcal_cli.report.plots import curve_plots, frames_plots
from semcal_cli.report.registration import RegistrationPictures
from semcal_cli.report.template import render_page
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.camera import intrinsic_texts
from semcal_cli.result.provenance import describe_input, versions
from semcal_cli.result.sections import DrivePart

SCRIPTS = tuple(f"report/{name}.js" for name in ("picture", "pictures", "cloud", "page"))


def write_report(
    report: ReportInput, path: Path, progress: Callable[[str], None] = lambda doing: None
) -> None:
    """Write the page.

    Args:
        report: Transform and frames that the page shows.
        path: HTML file to write.
        progress: Called with a description of each step.

    Raises:
        InputError: an image is missing or wrong, or the file cannot be written. An existing file stays untouched then.
    """
    write_text(report_html(report, progress), path)


def report_html(report: ReportInput, progress: Callable[[str], None]) -> str:
    """Gather everything and fill the template."""
    observations, T, record = report.observations, report.T_camera_lidar, report.record
    agreement, before = _core.agreement(observations.core, T), None
    if report.before is not None:
        # At another pose a rolling shutter sees points on other lines.
        T_before = report.before.T_camera_lidar
        seen = unrolled(report.seen_as(report.before.drive), T_before)
        before = _core.agreement(seen.core, T_before)
    # What is mostly Python takes the time in which something else is in the core or in an encoder.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(import_module, "matplotlib.figure")
        progress("drawing points on pictures")
        pictures = make_pictures(report.overlays(MAX_FRAMES))
        progress("following the mutual information along six axes")
        curves = information_curves(observations, T, record.believed_uncertainty if record else None)
        plots = pool.submit(curve_plots, curves)
        registration = pool.submit(_registration, report)
        cloud = pool.submit(frame_cloud, report)
        progress("calibrating each frame on its own")
        of_frames = _of_frames(report)
        progress("drawing the registration")
    progress("writing the page")
    return render_page(
        "report/page.html",
        SCRIPTS,
        words=words,
        report=report,
        record=record,
        verdict=words.verdict(report),
        notices=(*report.notices, *(record.notes if record else ())),
        agreement=agreement,
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        notations=notations(T),
        files=files(T, record.used_camera if record and record.camera else None),
        pictures=pictures,
        registration=registration.result(),
        classes=class_agreements(observations, agreement, before),
        plots=plots.result(),
        of_frames=of_frames,
        frame_names=frame_names([frame.points for frame in report.drive.frames]),
        frames_plots=frames_plots,
        num_parts=len(_parts(report)),
        intrinsics=intrinsic_texts(record.camera) if record and record.camera else [],
        error_of=lambda stage: compare_poses(np.array(stage.T_camera_lidar), T),
        reach=_reach(record) if record else None,
        cloud=asdict(cloud.result()),
        **_made_from(report),
    )


def _made_from(report: ReportInput) -> dict[str, Any]:
    """What the figures were made from: the calibration's own record, or else this version and these files."""
    record = report.record
    if record is None:
        hashes = describe_input(report.drive, None, Path(), files_of(LABELS)).sha256
        return {"options": "", "versions": versions(), "hashes": hashes}
    made_by, options = record.settings.versions, document_text(record.settings.options, "yaml")
    version = made_by.get("semcal", "")
    return {"options": options, "version": version, "versions": made_by, "hashes": record.input.sha256}


def _registration(report: ReportInput) -> str | None:
    """Draw the registration of the first frame, as a data URI; None if the calibration had none."""
    if report.record is None or not report.is_of_record:
        return None
    found = RegistrationPictures.of_record(report.seen_as(report.begun), report.record)
    return None if found is None else data_uri(found.draw(0), MAX_BYTES)


def _of_frames(report: ReportInput) -> FrameOffsets | None:
    """Calibrate each frame on its own; None with features, or of one frame."""
    observations, parts = report.observations, _parts(report)
    if observations.has_vectors or observations.num_frames < 2:
        return None
    return frame_offsets(observations, report.T_camera_lidar, parts)


def _parts(report: ReportInput) -> tuple[DrivePart, ...]:
    """Parts of the drive that fit a pose each, if the calibration was computed from the frames that are shown."""
    parts = () if report.record is None or not report.is_of_record else report.record.parts
    is_whole = sum(part.num_frames for part in parts) == report.observations.num_frames
    return parts if is_whole else ()


def _reach(record: Calibration) -> tuple[float, float]:
    """Range of the information of mountings less its bias, with one standard error to either side."""
    found = [
        (each.mutual_information_nats - each.bias_nats, each.sigma_nats or 0.0) for each in record.hypotheses
    ]
    low = min((nats - sigma for nats, sigma in found), default=0.0)
    high = max((nats + sigma for nats, sigma in found), default=1.0)
    return low, high
