"""The first stage: reading the frames of a drive that are used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

from semcal_cli.config import (
    AUTO,
    LABELS,
    MAX_FRAMES,
    CalibrationConfig,
    CueName,
    RefinementConfig,
    check_config,
)
from semcal_cli.drive.camera import Camera, with_sigma
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, Progress, StageDone, ignore
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.cue_table import choose_frames, chosen, files_of, load_cues, maximised
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.scenes import copied_frames


@dataclass(frozen=True)
class LoadedDrive:
    """The used frames of a drive, with the observations read from its files."""

    drive: Drive
    """Document of the drive, with the used frames."""
    observations: Observations
    """Points and pixels of these frames, for each cue by which a pose is refined."""
    cues: tuple[CueName, ...] = LABELS
    guide: Observations | None = None
    """Points and pixels by segments, which bring a pose near where edges then make it exact; otherwise None."""
    max_frames: int = MAX_FRAMES
    """Requested maximum number of frames."""
    num_copies: int = 0
    """Number of frames that were left out as copies of others."""
    recorded: Drive | None = None
    """Document of the drive with all frames, which show the motion between the used ones; None if not known."""

    def of_frames(self, indices: Sequence[int]) -> LoadedDrive:
        """Keep some of the frames, in both the document and the observations."""
        frames = tuple(self.drive.frames[index] for index in indices)
        drive = self.drive.model_copy(update={"frames": frames})
        observations = self.observations.of_frames(indices)
        guide, recorded = self.guide and self.guide.of_frames(indices), self.recorded
        if recorded is not None and frames:
            first, last = (recorded.frames.index(frame) for frame in (frames[0], frames[-1]))
            recorded = recorded.model_copy(update={"frames": recorded.frames[first : last + 1]})
        return replace(
            self, drive=drive, observations=observations, guide=guide, num_copies=0, recorded=recorded
        )

    def with_camera(self, camera: Camera) -> LoadedDrive:
        """Use another camera, with the same lens model and image size."""
        if camera == self.drive.camera:
            return self
        drive = self.drive.model_copy(update={"camera": camera})
        return replace(self, drive=drive, observations=replace(self.observations, camera=camera))

    def with_settings(self, config: RefinementConfig) -> LoadedDrive:
        """Use the maximum baseline and the edge band of these settings."""

        def with_both(seen: Observations) -> Observations:
            other = replace(seen, max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px)
            return seen if other.shared_settings == seen.shared_settings else other

        guide = None if self.guide is None else with_both(self.guide)
        return replace(self, observations=with_both(self.observations), guide=guide)

    def unrolled(self, T_camera_lidar: Pose) -> LoadedDrive:
        """Move the points as a rolling shutter sees them at a pose (4, 4): see `motion`."""
        observations = unrolled(self.observations, T_camera_lidar)
        return self if observations is self.observations else replace(self, observations=observations)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frames for the user."""
        notes = []
        if self.num_copies:
            count = len(self.drive.frames) + self.num_copies
            notes.append(f"{self.num_copies} of {count} frames are copies of others and are left out")
        frames = self.first_cue.frame_observations
        if num_rigid := sum(observed.is_rigid for observed in frames):
            notes.append(
                f"{num_rigid} of {len(frames)} sweeps have no point times, and are assumed to be deskewed to "
                "points_stamp"
            )
        return tuple(notes)

    @property
    def notes_on_networks(self) -> tuple[str, ...]:
        """How far a second network differs from the one whose image labels are used; empty without a second one."""
        second = None if self.drive.networks is None else self.drive.networks.second
        if second is None or "image_labels" not in files_of(self.cues):
            return ()
        return (second.sentence,)

    @property
    def first_cue(self) -> Observations:
        """Observations of the first cue by which a pose is refined."""
        return self.observations.of_cue(0)

    @property
    def for_checks(self) -> Observations:
        """Observations by which a pose is checked: by one cue, since pixels of one say nothing about points of another.

        Labels show most, then edges. Segments bring a pose near; next to them, intensity shows small offsets.
        """
        return self.of_cue(self.cues[-1]) if self.cues == ("segments", "intensity") else self.first_cue

    @property
    def is_refined_by_edges(self) -> bool:
        """Whether edges and no labels refine a pose, from several starts around it."""
        return "edges" in self.cues and "labels" not in self.cues

    @property
    def tells_mountings(self) -> bool:
        """Whether mounting directions can be told apart; edges alone only work near the right pose."""
        return not self.is_refined_by_edges or "segments" in self.cues

    @property
    def for_search(self) -> Observations:
        """Observations by which mounting directions are told apart, in classes that all frames share.

        Edges and intensity only show small offsets, but would weigh as much as segments.
        """
        if "labels" in self.cues and {"segments", "edges"} & {*self.cues}:
            return self.of_cue("labels")
        return self.of_cue("segments").of_classes if "segments" in self.cues else self.observations

    def of_cue(self, cue: CueName) -> Observations:
        """Observations of one of the cues by which the drive was loaded."""
        if self.guide is not None and cue == "segments":
            return self.guide
        return self.observations.of_cue(maximised(self.cues).index(cue))


def load(
    drive: LoadedDrive | Drive | Path | str,
    config: CalibrationConfig | None = None,
    on_event: Listener = ignore,
    sweeps: SweepCache | None = None,
) -> LoadedDrive:
    """Read the frames of a drive that are used; a loaded drive stays as it is.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, a setting is out of range, or the
            drive was loaded by other cues.
        CalibrationError: one side's labels carry no information.
    """
    start, config = perf_counter(), CalibrationConfig() if config is None else config
    check_config(config)
    if isinstance(drive, LoadedDrive):
        if config.cues not in (drive.cues, AUTO):
            found, needed = (" and ".join(names) for names in (drive.cues, config.cues))
            raise InputError(
                f"{drive.drive.path}: found a drive loaded by {found}, needed one loaded by {needed}"
            )
        return drive.with_camera(with_sigma(drive.drive.camera, config.refinement.jointly)).with_settings(
            config.refinement
        )
    whole = drive if isinstance(drive, Drive) else read_drive(drive)
    whole = whole.model_copy(update={"camera": with_sigma(whole.camera, config.refinement.jointly)})
    on_event(Progress(f"choosing from {len(whole.frames)} frames"))
    sweeps = sweeps or SweepCache()
    cues = chosen(config.cues, whole, sweeps)
    used = choose_frames(whole, cues, config.max_frames)
    on_event(Progress(f"reading {len(used.frames)} frames"))
    refined_by = maximised(cues)
    observations = load_cues(used, refined_by, sweeps, is_raw=config.is_raw).with_scenes
    guide = None if refined_by == cues else load_cues(used, ("segments",), sweeps)
    data = LoadedDrive(used, observations, cues, guide, config.max_frames, recorded=whole)
    data = data.with_settings(config.refinement)
    # Copies of frames add no evidence.
    seen = data.first_cue
    if copies := set(copied_frames(seen.scenes, [image.classes for image in seen.images])):
        kept = [index for index in range(seen.num_frames) if index not in copies]
        data = replace(data.of_frames(kept), num_copies=len(copies))
    note = _describe(data, len(whole.frames))
    if config.cues == AUTO and cues != LABELS:
        note += ", the best that its files allow"
    speckle = data.observations.speckle
    details = f"{speckle:.2%} isolated pixels corrected" if speckle > 0.0 else ""
    on_event(StageDone("load", perf_counter() - start, note, details=details))
    return data


def _describe(data: LoadedDrive, num_frames: int) -> str:
    """Describe the loaded drive, of `num_frames` frames, in one line for the terminal."""
    observations, num_used, motion = data.observations, len(data.drive.frames), data.drive.motion
    num_points = sum(cloud.num_points for cloud in data.first_cue.clouds)
    chosen = f" of {num_frames:,}" if num_used < num_frames else ""
    frames = "frame" if num_used == num_frames == 1 else "frames"
    note = (
        f"{num_used}{chosen} {frames}, {num_points:,} points, {len(observations.point_class_names)} point classes, "
        f"{len(observations.image_class_names)} image classes"
    )
    if data.num_copies:
        note += f", {data.num_copies} copies left out"
    if data.cues != LABELS:
        note += f", by {' and '.join(data.cues)}"
    if motion is None:
        return note
    if motion.speed_m_s is None:
        return f"{note}, motion compensated"
    error_px = observations.motion_error_px
    off = (
        "clouds have no times"
        if error_px is None
        else f"half of the points are off by {error_px:.1f} pixels or more"
    )
    return f"{note}, motion not compensated: {off}"
