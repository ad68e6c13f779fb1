"""The report page: the template filled with all figures, images, style and script."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from semcal_cli import _core
from semcal_cli.assessment.frame_names import frame_names
from semcal_cli.assessment.frame_offsets import FrameOffsets, frame_offsets
from semcal_cli.config import LABELS
from semcal_cli.drive.cues import files_of
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.shutter import unrolled
from semcal_cli.files.dialect import document_text
from semcal_cli.files.writing import write_text
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.report.classes import class_agreements
from semcal_cli.report.cloud import frame_cloud
from semcal_cli.report.curves import information_curves
from semcal_cli.report.input import ReportInput
from semcal_cli.report.notations import files, notations
from semcal_cli.report.pictures import MAX_BYTES, MAX_FRAMES, data_uri, make_pictures
from semcal_cli.report.plots import Plot, curve_plots, frames_plots
from semcal_cli.report.registration import RegistrationPictures
from semcal_cli.report.template import ENVIRONMENT, source
from semcal_cli.report.words import (
    camera_sentences,
    frame_sentences,
    polish_sentence,
    runner_up_sentence,
    uncertainty_sentences,
    verdict,
)
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.camera_words import intrinsic_texts
from semcal_cli.result.provenance import describe_input, versions


@dataclass(frozen=True)
class StageRow:
    """A stage of the calibration, and the distance of its pose from the result."""

    name: str
    note: str
    nats: float
    rotation_deg: float
    camera_center_cm: float


@dataclass(frozen=True)
class HypothesisRow:
    """A mounting hypothesis, and its place between the worst and the best one."""

    nats: float
    sigma_nats: float | None
    looks_along: tuple[float, ...]
    rotation_from_best_deg: float
    overlap: float
    left: float
    """Left end of the bar of one standard error to either side, as a share of the row's width."""
    width: float


@dataclass(frozen=True)
class OfFrames:
    """What the page shows of the poses of single frames."""

    sentences: list[str]
    plots: list[Plot]
    rows: list[list[str]]
    """For each frame its name and its six offsets with their intervals, as text."""


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
    agreement = _core.agreement(observations.core, T)
    made_by = record.settings.versions if record else versions()
    before = None
    if report.before is not None:
        before = _agreement(report.seen_as(report.before.drive), report.before.T_camera_lidar)
    # What is mostly Python takes the time in which something else is in the core or in an encoder.
    with ThreadPoolExecutor(1) as pool:
        template = pool.submit(ENVIRONMENT.get_template, "report/page.html")
        progress("drawing points on pictures")
        pictures = make_pictures(report.overlays(MAX_FRAMES))
        progress("following the mutual information along six axes")
        curves = information_curves(observations, T, record.believed_uncertainty if record else None)
        registration = pool.submit(_registration, report)
        cloud = pool.submit(frame_cloud, report)
        progress("calibrating each frame on its own")
        of_frames = _of_frames(report)
        progress("drawing the registration")
    progress("writing the page")
    return template.result().render(
        style=source("page.css"),
        script=source("copy.js", "picture.js", "pictures.js", "cloud.js", "page.js"),
        report=report,
        record=record,
        verdict=verdict(report),
        notices=(*report.notices, *(report.record.notes if report.record else ())),
        agreement=agreement,
        num_visible=agreement.num_inside - agreement.num_hidden,
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        notations=notations(T),
        files=files(T, record.used_camera if record and record.camera else None),
        pictures=pictures,
        registration=registration.result(),
        classes=class_agreements(observations, agreement, before),
        plots=curve_plots(curves),
        of_frames=of_frames,
        uncertainty=uncertainty_sentences(record, observations.camera) if record else [],
        camera_sentences=camera_sentences(record) if record else [],
        intrinsics=intrinsic_texts(record.camera) if record and record.camera else [],
        runner_up=runner_up_sentence(record) if record else None,
        polish=polish_sentence(record) if record else None,
        stages=_stage_rows(record) if record else [],
        hypotheses=_hypothesis_rows(record) if record else [],
        cloud=asdict(cloud.result()),
        options=document_text(record.settings.options, "yaml") if record else "",
        version=made_by.get("semcal", ""),
        versions=made_by,
        hashes=(
            record.input if record else describe_input(report.drive, None, Path(), files_of(LABELS))
        ).sha256,
    )


def _agreement(observations: Observations, T_camera_lidar: Pose) -> _core.Agreement:
    """Compare labels at another pose than that of the report, where a rolling shutter sees points on other lines."""
    return _core.agreement(unrolled(observations, T_camera_lidar).core, T_camera_lidar)


def _registration(report: ReportInput) -> str | None:
    """Draw the registration of the first frame, as a data URI; None if the calibration had none."""
    if report.record is None or not report.is_of_record:
        return None
    found = RegistrationPictures.of_record(report.seen_as(report.begun), report.record)
    return None if found is None else data_uri(found.draw(0), MAX_BYTES)


def _of_frames(report: ReportInput) -> OfFrames | None:
    """Calibrate each frame on its own; None with features, or of one frame."""
    observations, record = report.observations, report.record
    if observations.has_vectors or observations.num_frames < 2:
        return None
    parts = () if record is None else record.parts
    if not report.is_of_record or sum(part.num_frames for part in parts) != observations.num_frames:
        parts = ()
    found = frame_offsets(observations, report.T_camera_lidar, parts)
    names = frame_names([frame.points for frame in report.drive.frames])
    return OfFrames(
        sentences=frame_sentences(found, names, len(parts)),
        plots=frames_plots(found, names),
        rows=_frame_rows(found, names),
    )


def _frame_rows(found: FrameOffsets, names: Sequence[str]) -> list[list[str]]:
    """List the name of each frame, and its offsets with their intervals in centimetres and degrees."""
    rows = []
    for name, offsets, half_widths in zip(names, found.offsets, found.half_widths_95, strict=True):
        if not np.isfinite(offsets).all():
            rows.append([name, *["-"] * 6])
            continue
        center = [
            f"{100 * x:.2f} \u00b1 {100 * half:.2f}"
            for x, half in zip(offsets[:3], half_widths[:3], strict=True)
        ]
        turn = [f"{x:.3f} \u00b1 {half:.3f}" for x, half in zip(offsets[3:], half_widths[3:], strict=True)]
        rows.append([name, *center, *turn])
    return rows


def _stage_rows(record: Calibration) -> list[StageRow]:
    rows = []
    for name, stage in record.stages.items():
        error = compare_poses(np.array(stage.T_camera_lidar), record.pose)
        is_rejected = name == "polished" and record.polish is not None and not record.polish.accepted
        note, nats = "rejected" if is_rejected else "", stage.mutual_information_nats
        rows.append(StageRow(name, note, nats, error.rotation_deg, error.camera_center_cm))
    return rows


def _hypothesis_rows(record: Calibration) -> list[HypothesisRow]:
    nats = [each.mutual_information_nats - each.bias_nats for each in record.hypotheses]
    sigmas = [each.sigma_nats or 0.0 for each in record.hypotheses]
    ends = [(middle - sigma, middle + sigma) for middle, sigma in zip(nats, sigmas, strict=True)]
    low, high = min((end for end, _ in ends), default=0.0), max((end for _, end in ends), default=1.0)
    scale = 100.0 / (high - low) if high > low else 0.0
    return [
        HypothesisRow(
            nats=middle,
            sigma_nats=each.sigma_nats,
            looks_along=each.T_camera_lidar[2][:3],
            rotation_from_best_deg=each.rotation_from_best_deg,
            overlap=each.overlap,
            left=scale * (begin - low),
            width=scale * (end - begin),
        )
        for each, middle, (begin, end) in zip(record.hypotheses, nats, ends, strict=True)
    ]
