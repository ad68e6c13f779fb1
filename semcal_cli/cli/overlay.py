"""`semcal overlay`: points drawn on images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import click

from semcal_cli.cli.options import DriveSettings, cue_list, reference_direction
from semcal_cli.cli.rules import FOR_ONE_CAMERA, given, one_of, refuse
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.config import AUTO, LABELS, CueName
from semcal_cli.config.directions import Direction

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.observations.observations import Observations
    from semcal_cli.report.overlays import Overlays

Coloring: TypeAlias = Literal["class", "depth", "agreement", "segment", "edge"]


@dataclass(frozen=True, kw_only=True)
class OverlaySettings(DriveSettings):
    """Settings of `overlay`."""

    rules = [
        one_of("-o", "--video"),
        given("--force").requires("--video"),
        given("--labels").excludes("--by edge", because="edges are drawn there"),
    ]
    calibration: Path = argument()
    output: Path | None = option(
        "Folder for the images, each named after its frame.", "-o", "--output", metavar="DIR"
    )
    video: Path | None = output_file("File for the images as a video of 5 frames in a second: .mp4.")
    force: bool = option("Replace the file of --video.", default=False)
    point_size: int | None = option(
        "Radius of the points in pixels.  [default: by the width of the images]", minimum=1, maximum=50
    )
    opacity: float = option("Opacity of the points.", default=1.0, above=0.0, maximum=1.0)
    outline: bool = option("Draw a black outline around points.", default=False)
    labels: bool = option(
        "Draw the image labels on the images, in the colours of their classes.", default=False
    )
    against: Path | None = option("Second transform, shown next to the first.", metavar="FILE")
    reference_direction: Direction | None = reference_direction()
    by: Coloring | None = option(
        "What the colours of the points show. class: their class. depth: their distance from the camera. agreement: "
        "whether the classes of point and pixel go together. segment: the part of the sweep, found by shape, that they "
        "belong to, which is a cell of the ground or an object. edge: how far range (orange) or intensity (blue) steps "
        "next to them, drawn on the edges of the image. depth, segment and edge need no labels.  [default: class; with "
        "--against, agreement; for the cue edges, edge]"
    )
    cues: tuple[CueName, ...] = cue_list()
    max_frames: int = option("Draw at most N evenly spaced frames.", default=20, minimum=1)

    def styled(self, overlays: Overlays) -> Overlays:
        """Choose how points are drawn, and whether image labels are."""
        return overlays.styled(
            self.point_size, self.opacity, has_outline=self.outline, draws_labels=self.labels
        )


@command(OverlaySettings)
def overlay(settings: OverlaySettings) -> None:
    """Draw the points of DRIVE on its images, at the transform in CALIBRATION.

    CALIBRATION is {KNOWN_TRANSFORMS}. For a rig.yaml, it is the folder that semcal calibrate wrote, and each camera
    gets a folder of images. Points that the camera cannot see are left out, or grey with --by agreement.
    """
    from semcal_cli.drive.document import read_drive
    from semcal_cli.files.output_files import make_folder
    from semcal_cli.many.rig.rig_document import find_rig
    from semcal_cli.many.rig.rig_result import read_rig_files
    from semcal_cli.report.overlays import Overlays
    from semcal_cli.result.applied import cues_applied

    terminal, output = settings.terminal(), settings.output
    if (rig := find_rig(settings.drive)) is None:
        overlays = _overlays(read_drive(settings.drive, settings.max_points), settings, terminal)
        if output is not None:
            terminal.print(*map(str, overlays.write_all(output)))
        if settings.video is not None:
            overlays.write_video(settings.video)
            terminal.print(str(settings.video))
        return
    refuse(click.get_current_context(), ["--against", "--video"], FOR_ONE_CAMERA.format(rig.path))
    assert output is not None
    result, drives, read = read_rig_files(rig, settings.calibration, settings.max_points)
    drives = {name: _few(drive, settings, output / name, read) for name, drive in drives.items()}
    for name, camera in result.cameras.items():
        make_folder(output / name, output)
        cues = cues_applied(camera, settings.cues, drives[name])
        by, observations = _observe(drives[name], settings, cues, "class")
        observations = observations.along_scans(camera.pose)
        overlays = settings.styled(Overlays(drives[name], observations, {name: camera.pose}, by))
        terminal.print(*map(str, overlays.write_all(output / name)))
    for name, reason in result.failures.items():
        terminal.print(f"{name}: found no transform to draw with: {reason}")


def _overlays(drive: Drive, settings: OverlaySettings, terminal: Terminal) -> Overlays:
    """Prepare the images of a drive at one or two transforms, and report where a camera or a clock differs."""
    from semcal_cli.cli.output_checks import files_read
    from semcal_cli.formats import read_reference
    from semcal_cli.report.overlays import Overlays
    from semcal_cli.result.applied import apply_result, cues_applied, seen_as

    calibration, against = settings.calibration, settings.against
    paths = [path for path in (against, calibration) if path is not None]
    extrinsics = {str(path): read_reference(path, settings.reference_direction) for path in paths}
    frames = _few(drive, settings, settings.output, files_read(drive, against, calibration)).frames
    applied = {name: apply_result(extrinsic.record, drive, name) for name, extrinsic in extrinsics.items()}
    for result in applied.values():
        terminal.print_changes(result.changes)
    spec = applied.pop(str(calibration)).drive.model_copy(update={"frames": frames})
    cues = cues_applied(extrinsics[str(calibration)].record, settings.cues, spec)
    by, observations = _observe(spec, settings, cues, "class" if against is None else "agreement")
    observations = observations.along_scans(extrinsics[str(calibration)].T_camera_lidar)
    others = {name: seen_as(observations, spec, result.drive) for name, result in applied.items()}
    poses = {name: extrinsic.T_camera_lidar for name, extrinsic in extrinsics.items()}
    return settings.styled(Overlays(spec, observations, poses, by, others))


def _few(drive: Drive, settings: OverlaySettings, folder: Path | None, read: list[Path]) -> Drive:
    """Keep evenly spaced frames of a drive, and check that what is drawn of them replaces no input."""
    from semcal_cli.cli.output_checks import check_image_folder, check_outputs, check_vacant
    from semcal_cli.files.output_files import check_suffix
    from semcal_cli.observations.frame_selection import with_few_frames

    few = with_few_frames(drive, settings.max_frames)
    if folder is not None:
        check_image_folder(folder, read)
    check_suffix(settings.video, ".mp4")
    check_outputs(read, settings.video)
    check_vacant(settings.video, force=settings.force)
    return few


def _observe(
    drive: Drive, settings: OverlaySettings, cues: tuple[CueName, ...], class_coloring: Coloring
) -> tuple[Coloring, Observations]:
    """Load what the colours show of the frames of a drive, and return their meaning.

    By default, that is edges if a pose is refined by them, and otherwise `class_coloring`.
    """
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.observations.cues.cue_table import choose_cues, load_cues, policy_of
    from semcal_cli.observations.reading import load_points
    from semcal_cli.report.colors import coloring_of

    sweeps, by, with_labels = SweepCache(), settings.by, settings.labels
    if by in ("depth", "segment") and not with_labels:
        return by, load_points(drive)
    if by == "edge":
        return by, load_cues(drive, ("edges",))
    # Classes mean labels: without any, the error says what is missing.
    is_of_labels = by == "class" and cues == AUTO
    # Pixels of one cue share no information with points of another: the first one is shown.
    shown = policy_of(LABELS if is_of_labels else choose_cues(cues, drive, sweeps)).refined[:1]
    observations = load_cues(drive, shown, sweeps, is_raw=True)
    return by or ("edge" if coloring_of(observations) == "edge" else class_coloring), observations
