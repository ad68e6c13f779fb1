"""What every command that computes a calibration does around it: console, log, result."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from semcal_cli.drive.document import read_drive
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.errors import InputError
from semcal_cli.files.documents import output_format
from semcal_cli.files.reading import is_folder
from semcal_cli.files.writing import write_text
from semcal_cli.formats import write_transform
from semcal_cli.geometry.poses import Pose, camera_center
from semcal_cli.pipeline import Run, StageReport, set_threads
from semcal_cli.result.calibration import (
    Calibration,
    Repeatability,
    UncertaintyRecord,
    calibration_text,
    write_calibration,
)

if TYPE_CHECKING:
    from semcal_cli.config import Cue
    from semcal_cli.drive.document import Drive
    from semcal_cli.formats.format import Asked
    from semcal_cli.geometry.pose_error import PoseError
    from semcal_cli.initialization.search import Hypothesis
    from semcal_cli.pipeline import Given

EXIT_NOT_TRUSTED = 3
MAX_PICTURES = 20
"""Of so many frames, evenly spaced, pictures are made."""


class Session:
    """Runs one calibration for the terminal; a context manager that owns the progress line."""

    def __init__(
        self,
        drive: Path | Drive,
        *,
        output: Path | None = None,
        log: Path | None = None,
        seed: int = 0,
        threads: int | None = None,
        quiet: bool = False,
        max_frames: int | None = None,
        cues: tuple[Cue, ...] = ("labels",),
        given: Given | None = None,
        to: tuple[str, Asked] | None = None,
        page: Path | None = None,
        pictures: Path | None = None,
    ) -> None:
        """Check everything that can be wrong before the work begins.

        `given` is a transform that the command reads, too; `to` a format to write the transform in, instead of all that
        is known; `page` and `pictures` where a report and pictures go.

        Raises:
            InputError: the drive is invalid, or the result or the log cannot go where they shall.
        """
        spec = read_drive(drive) if isinstance(drive, Path) else drive
        read = [
            spec.path,
            *map(spec.resolve, spec.files()),
            *([given.source] if given and given.source else []),
        ]
        if page is not None:
            check_page(page)
        if page is not None or pictures is not None:
            _check_images(spec)
        if pictures is not None:
            check_pictures(pictures, MAX_PICTURES, read)
        check_outputs(read, [path for path in (output, log, page) if path is not None])
        if to is not None:
            write_transform(np.eye(4), None, *to)
        elif output is not None:
            output_format(output)
        self.console = make_console(quiet)
        self.output, self.log, self.threads, self.to = output, log, threads, to
        self.reports: list[StageReport] = []
        self._line = ExitStack()
        self._progress: Callable[[str], None] = lambda doing: None
        self.run = Run(spec, seed, report=self._report, progress=self.progress, cues=cues)
        if max_frames is not None:
            self.run.max_frames = max_frames
        set_threads(threads)

    def __enter__(self) -> Session:
        self._progress = self._line.enter_context(progress_line(self.console))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._line.close()

    @property
    def folder(self) -> Path:
        """Where the result goes."""
        return self.output.parent if self.output else Path()

    def finish(self, calibration: Calibration) -> int:
        """Write and summarise a calibration, and tell the exit code: 3 if it is not trusted."""
        self._line.close()
        if self.log is not None:
            write_text(json.dumps(self.log_document(), indent=2) + "\n", self.log)
        if self.to is not None:
            content = write_transform(calibration.pose, self.output, *self.to)
            if self.output is None:
                click.echo(content, nl=False)
        elif self.output is None:
            click.echo(calibration_text(calibration, "yaml"), nl=False)
        else:
            write_calibration(calibration, self.output)
        self._summarise(calibration)
        return EXIT_NOT_TRUSTED if calibration.status == "not_trusted" else 0

    def illustrate(self, calibration: Calibration, page: Path | None, pictures: Path | None) -> None:
        """Write a page about a calibration, and pictures, where asked."""
        if page is None and pictures is None:
            return
        from semcal_cli.report import make_subject, write_report

        name = str(self.output or "calibration")
        with progress_line(self.console) as progress:
            progress("reading frames")
            subject = make_subject(self.run.drive, name, calibration.pose, calibration)
            if page is not None:
                write_report(subject, page, progress)
                self.console.print(f"{'report':<17}{page}", markup=False)
            if pictures is not None:
                progress("drawing points on pictures")
                for path in subject.overlays(MAX_PICTURES).write_all(pictures):
                    self.console.print(f"{'picture':<17}{path}", markup=False)

    def show(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Print the hypotheses of the initial calibration."""
        self.console.print(
            "            MI, nats          looks along (LiDAR frame)           overlap    pairs  inliers"
        )
        for number, h in enumerate(hypotheses, start=1):
            looks_along = " ".join(f"{x:8.4f}" for x in h.T_camera_lidar[2, :3])
            self.console.print(
                f"  {number:>2}.  {h.mutual_information_nats:8.4f} +- {h.sigma_nats:6.4f}   {looks_along}   "
                f"{h.overlap:7.0%}  {_count(h.num_pairs)}  {_count(h.num_inliers)}",
                markup=False,
            )

    def progress(self, doing: str) -> None:
        """Show what is being done, on a terminal."""
        self._progress(doing)

    def _report(self, report: StageReport) -> None:
        self.reports.append(report)
        figures = "" if report.agreement is None else f"MI {report.agreement.mutual_information:.4f} nats   "
        if report.moved is not None:
            figures += f"moved {report.moved.rotation_deg:.4f} deg, {report.moved.camera_center_cm:.3f} cm   "
        self.console.print(f"{report.name:<8} {report.seconds:6.2f} s   {figures}{report.note}", markup=False)

    def _summarise(self, calibration: Calibration) -> None:
        T = calibration.pose
        quality = calibration.quality
        rows = {
            "T_camera_lidar": matrix_lines(T),
            "camera at": [f"{row(camera_center(T).tolist())} m in the LiDAR frame"],
            "looks along": [f"{row(T[2, :3].tolist())} in the LiDAR frame"],
            "labels": [
                f"{quality.label_agreement:.1%} of the pairs of {quality.num_points:,} visible points agree",
                f"they cover {quality.overlap:.0%} of the picture",
            ],
            **_uncertainty_rows(calibration.uncertainty),
            **_repeatability_rows(calibration.repeatability),
            "status": [calibration.status, *calibration.reasons],
            "written to": [str(self.output) if self.output else "standard output"],
        }
        for name, lines in rows.items():
            for label, line in zip([name, *[""] * len(lines)], lines, strict=False):
                self.console.print(f"{label:<17}{line}", markup=False)

    def log_document(self) -> dict[str, object]:
        """Give times, host and threads."""
        stages = [{"name": r.name, "seconds": round(r.seconds, 4), "note": r.note} for r in self.reports]
        host = {
            "machine": platform.machine(),
            "system": platform.platform(),
            "python": platform.python_version(),
        }
        return {"stages": stages, "host": host, "threads": self.threads}


def _uncertainty_rows(uncertainty: UncertaintyRecord | None) -> dict[str, list[str]]:
    """What is known of the pose's error, for reading; intervals are along the camera's axes."""
    if uncertainty is None:
        return {}
    center, rotation = uncertainty.half_width_95_camera_center_m, uncertainty.half_width_95_rotation_deg
    lines = [
        f"camera centre x y z +- {row([100.0 * x for x in center], 3)} cm",
        f"rotation about them +- {row(rotation, 4)} deg",
        *(f"weak {direction}" for direction in uncertainty.weak_directions),
    ]
    rows = {"95 % interval": lines}
    if uncertainty.label_bleed is not None:
        moved_cm = 100.0 * np.linalg.norm(uncertainty.label_bleed.camera_center_m)
        turned_deg = np.linalg.norm(uncertainty.label_bleed.rotation_deg)
        rows["labels 1 px off"] = [f"would move it by {moved_cm:.2f} cm and {turned_deg:.3f} deg"]
    return rows


def _repeatability_rows(found: Repeatability | None) -> dict[str, list[str]]:
    if found is None or found.spread_camera_center_m is None or found.spread_rotation_deg is None:
        return {}
    center = [100.0 * x for x in found.spread_camera_center_m]
    lines = [
        f"camera centre x y z    {row(center, 3)} cm, standard deviation",
        f"rotation about them    {row(found.spread_rotation_deg, 4)} deg",
    ]
    return {f"{found.num_seeds} seeds": lines}


def _check_images(spec: Drive) -> None:
    """Check the pictures that points will be drawn on, if the drive is no longer than what is shown of it."""
    from semcal_cli.drive.observations import read_frame_image

    for index in evenly_spaced(range(len(spec.frames)), MAX_PICTURES):
        read_frame_image(spec, spec.frames[index])


def check_outputs(read: Sequence[Path], outputs: Sequence[Path]) -> None:
    """Check that results have a folder to go to, and overwrite neither an input nor one another."""
    taken = set(map(os.path.realpath, read))
    for path in outputs:
        if not is_folder(path.absolute().parent):
            raise InputError(f"{path}: found no folder {path.parent}, needed one to write to")
        if is_folder(path):
            raise InputError(f"{path}: is a folder, needed a file to write to")
        if os.path.realpath(path) in taken:
            raise InputError(f"{path}: found a file that this run reads or writes, needed another name")
        taken.add(os.path.realpath(path))


def check_pictures(folder: Path, count: int, read: Sequence[Path]) -> None:
    """Check that pictures would not replace files that are read.

    Raises:
        InputError: they would.
    """
    from semcal_cli.report.overlay import picture_paths

    if folder.exists() and not is_folder(folder):
        raise InputError(f"{folder}: found a file, needed a folder for pictures")
    taken = set(map(os.path.realpath, read))
    for path in picture_paths(folder, count):
        if os.path.realpath(path) in taken:
            raise InputError(f"{path}: found a file that this run reads, needed another folder")


def check_page(path: Path) -> None:
    """Check the suffix of a page.

    Raises:
        InputError: it is none of HTML.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed .html")


@contextmanager
def progress_line(console: Console) -> Iterator[Callable[[str], None]]:
    """Show what is being done, and for how long, on a terminal."""
    if not console.is_terminal:
        yield lambda doing: None
        return
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("")
        yield lambda doing: progress.update(task, description=doing)


def make_console(quiet: bool) -> Console:
    """A console on stderr that neither wraps nor highlights, so that a pipe gets plain lines."""
    return Console(stderr=True, quiet=quiet, highlight=False, soft_wrap=True)


def error_lines(error: PoseError) -> list[str]:
    """The difference between a calibration and a reference, for reading."""
    return [
        f"rotation       {error.rotation_deg:8.4f} deg   x y z {row(error.rotation_xyz_deg)} deg",
        f"camera centre  {error.camera_center_cm:8.3f} cm    x y z {row(error.camera_center_xyz_cm)} cm",
    ]


def _count(number: int | None) -> str:
    return f"{'-' if number is None else format(number, ','):>7}"


def matrix_lines(T: Pose) -> list[str]:
    """Write a transform, a row a line."""
    return [row(values) for values in T.tolist()]


def row(values: Sequence[float], digits: int = 6) -> str:
    """Write numbers side by side."""
    return " ".join(f"{value:{digits + 4}.{digits}f}" for value in np.round(values, digits) + 0.0)
