"""The page itself: everything gathered and put into the template, with style and script inside."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from semcal_cli import _core
from semcal_cli.calibration import Calibration
from semcal_cli.documents import document_text, write_text
from semcal_cli.metrics import compare_poses
from semcal_cli.poses import camera_center
from semcal_cli.provenance import versions
from semcal_cli.report.classes import class_agreements
from semcal_cli.report.cloud import frame_cloud
from semcal_cli.report.curves import information_curves
from semcal_cli.report.frames import frame_pictures
from semcal_cli.report.notations import files, notations
from semcal_cli.report.plots import HEIGHT, WIDTH, plots
from semcal_cli.report.subject import Subject
from semcal_cli.report.words import runner_up_sentence, uncertainty_sentences, verdict

ENVIRONMENT = Environment(
    loader=PackageLoader("semcal_cli.report", "."),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


@dataclass(frozen=True)
class StageRow:
    """A stage, and how far its pose was from the last."""

    name: str
    nats: float
    rotation_deg: float
    camera_center_cm: float


@dataclass(frozen=True)
class HypothesisRow:
    """A mounting that the search arrived at, and its place between the worst and the best."""

    nats: float
    sigma_nats: float | None
    looks_along: tuple[float, ...]
    rotation_from_best_deg: float
    overlap: float
    left: float
    """Of the bar that one standard error to either side makes, in the row's width."""
    width: float


def write_report(subject: Subject, path: Path, progress: Callable[[str], None] = lambda doing: None) -> None:
    """Write the page.

    Args:
        subject: What it is about.
        path: Where it goes.
        progress: Told what is being done.

    Raises:
        InputError: a picture is missing or wrong, or the file cannot be written. An existing one is untouched then.
    """
    write_text(report_html(subject, progress), path)


def report_html(subject: Subject, progress: Callable[[str], None]) -> str:
    """Gather everything and fill the template."""
    observations, T, record = subject.observations, subject.T_camera_lidar, subject.record
    agreement = _core.agreement(observations.core, T)
    before = None if subject.before is None else _core.agreement(observations.core, subject.before[1])
    progress("drawing points on pictures")
    frames, legend = frame_pictures(subject)
    progress("following the mutual information along six axes")
    curves = information_curves(observations, T, record.uncertainty if record else None)
    progress("writing the page")
    return ENVIRONMENT.get_template("page.html").render(
        style=_source("page.css"),
        script=_source("page.js"),
        subject=subject,
        record=record,
        verdict=verdict(subject),
        agreement=agreement,
        num_visible=agreement.num_inside - agreement.num_hidden,
        camera_center=camera_center(T).tolist(),
        optical_axis=T[2, :3].tolist(),
        notations=notations(T),
        files=files(T),
        frames=frames,
        legend=legend,
        classes=class_agreements(observations, agreement, before),
        plots=plots(curves),
        plot_size=(WIDTH, HEIGHT),
        uncertainty=uncertainty_sentences(record, observations.camera) if record else [],
        runner_up=runner_up_sentence(record) if record else None,
        stages=_stage_rows(record) if record else [],
        hypotheses=_hypothesis_rows(record) if record else [],
        cloud=asdict(frame_cloud(subject)),
        options=document_text(record.settings.options, "yaml") if record else "",
        versions=record.settings.versions if record else versions(),
        hashes=record.input.sha256 if record else subject.input.sha256,
    )


def _source(name: str) -> Markup:
    """A file of ours that goes in as it is."""
    return Markup((Path(__file__).parent / name).read_text())


def _stage_rows(record: Calibration) -> list[StageRow]:
    rows = []
    for name, stage in record.stages.items():
        error = compare_poses(np.array(stage.T_camera_lidar), record.pose)
        rows.append(StageRow(name, stage.mutual_information_nats, error.rotation_deg, error.camera_center_cm))
    return rows


def _hypothesis_rows(record: Calibration) -> list[HypothesisRow]:
    found: list[dict[str, Any]] = []
    for each in record.hypotheses:
        nats, sigma = each.mutual_information_nats - each.bias_nats, each.sigma_nats or 0.0
        found.append({"each": each, "low": nats - sigma, "high": nats + sigma, "nats": nats})
    low = min((row["low"] for row in found), default=0.0)
    high = max((row["high"] for row in found), default=1.0)
    span = high - low if math.isfinite(high - low) and high > low else 1.0
    return [
        HypothesisRow(
            nats=row["nats"],
            sigma_nats=row["each"].sigma_nats,
            looks_along=row["each"].T_camera_lidar[2][:3],
            rotation_from_best_deg=row["each"].rotation_from_best_deg,
            overlap=row["each"].overlap,
            left=100.0 * (row["low"] - low) / span,
            width=100.0 * (row["high"] - row["low"]) / span,
        )
        for row in found
    ]
