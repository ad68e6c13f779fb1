"""The first stage: reading the frames of a drive that are used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from semcal_cli.observations.cues.cue_table import (
    choose_cues,
    choose_frames,
    files_of,
    is_default,
    load_cues,
    policy_of,
)
from semcal_cli.observations.cues.policy import Policy
from semcal_cli.observations.motion import unrolled
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.scenes import copied_frames

MIN_SIDE = 4
"""Smallest side of an image, pixels: that of the coarsest blocks on which a pose is assessed."""


@dataclass(frozen=True)
class LoadedDrive:
    """The used frames of a drive, with the observations read from its files."""

    drive: Drive
    """Document of the drive, with the used frames."""
    observations: Observations
    """Points and pixels of these frames, for each cue by which a pose is refined."""
    cues: tuple[CueName, ...] = LABELS
    coarse_cue: Observations | None = None
    """Points and pixels by cues that bring a pose near, as segments do for edges; None without such a cue."""
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
        coarse_cue, recorded = self.coarse_cue and self.coarse_cue.of_frames(indices), self.recorded
        if recorded is not None and frames:
            first, last = (recorded.frames.index(frame) for frame in (frames[0], frames[-1]))
            recorded = recorded.model_copy(update={"frames": recorded.frames[first : last + 1]})
        return replace(
            self,
            drive=drive,
            observations=observations,
            coarse_cue=coarse_cue,
            num_copies=0,
            recorded=recorded,
        )

    def with_camera(self, camera: Camera) -> LoadedDrive:
        """Use another camera, with the same lens model and image size."""
        if camera == self.drive.camera:
            return self
        drive = self.drive.model_copy(update={"camera": camera})
        coarse_cue = self.coarse_cue and replace(self.coarse_cue, camera=camera)
        observations = replace(self.observations, camera=camera)
        return replace(self, drive=drive, observations=observations, coarse_cue=coarse_cue)

    def with_settings(self, config: RefinementConfig) -> LoadedDrive:
        """Use the maximum baseline and the edge band of these settings."""

        def with_both(observations: Observations) -> Observations:
            other = replace(
                observations, max_baseline_m=config.max_baseline_m, edge_band_px=config.edge_band_px
            )
            return observations if other.shared_settings == observations.shared_settings else other

        coarse_cue = None if self.coarse_cue is None else with_both(self.coarse_cue)
        return replace(self, observations=with_both(self.observations), coarse_cue=coarse_cue)

    def along_scans(self, T_camera_lidar: Pose) -> LoadedDrive:
        """Take image gradients along the scan lines, as a pose (4, 4) projects them that is known to some degrees."""
        observations = self.observations.along_scans(T_camera_lidar)
        return self if observations is self.observations else replace(self, observations=observations)

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
        motion = self.drive.motion
        is_stated = motion is not None and motion.point_times == "deskewed"
        if not is_stated and (num_rigid := sum(observed.is_rigid for observed in frames)):
            notes.append(
                f"{num_rigid} of {len(frames)} sweeps have no point times, and are moved as a whole: if they are "
                "deskewed to points_stamp, motion.point_times: deskewed says so"
            )
        return tuple(notes)

    @property
    def notes_on_spin(self) -> tuple[str, ...]:
        """A note that the spin of the LiDAR is not used, if it is stated and the drive gives no direction of motion."""
        lidar, motion = self.drive.lidar, self.drive.motion
        if lidar is None or lidar.spin is None or (motion is not None and not motion.speed_m_s):
            return ()
        return ("lidar.spin deskews no sweep, because the drive gives neither motion.poses nor motion.twist",)

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

    @cached_property
    def policy(self) -> Policy:
        """What the cues state together."""
        return policy_of(self.cues)

    @property
    def checked_by(self) -> Observations:
        """Observations by which a pose is checked, of one cue."""
        return self.of_cue(self.policy.checked_by)

    @property
    def searched_by(self) -> Observations:
        """Observations by which mounting directions are distinguished, in classes that all frames share."""
        cue = self.policy.searched_by
        return self.observations if cue is None else self.of_cue(cue).of_classes

    def of_cue(self, cue: CueName) -> Observations:
        """Return the observations of one of the cues by which the drive was loaded."""
        refined, coarse = self.policy.refined, self.policy.coarse
        if self.coarse_cue is not None and cue in coarse:
            return self.coarse_cue.of_cue(coarse.index(cue))
        return self.observations.of_cue(refined.index(cue))


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
                f"{drive.drive.path}: found a drive loaded by {found}, expected one loaded by {needed}"
            )
        return drive.with_camera(with_sigma(drive.drive.camera, config.refinement.jointly)).with_settings(
            config.refinement
        )
    whole = drive if isinstance(drive, Drive) else read_drive(drive)
    width, height = whole.camera.size
    if min(width, height) < MIN_SIDE:
        raise InputError(
            f"{whole.path}: camera: found {width} x {height} pixels, needed at least {MIN_SIDE} x {MIN_SIDE}"
        )
    whole = whole.model_copy(update={"camera": with_sigma(whole.camera, config.refinement.jointly)})
    on_event(Progress(f"choosing from {len(whole.frames)} frames"))
    sweeps = sweeps or SweepCache()
    cues = choose_cues(config.cues, whole, sweeps)
    used = choose_frames(whole, cues, config.max_frames)
    on_event(Progress(f"reading {len(used.frames)} frames"))
    policy = policy_of(cues)
    observations = load_cues(used, policy.refined, sweeps, is_raw=config.is_raw).with_scenes
    observations = replace(observations, starts=policy.starts)
    coarse_cue = load_cues(used, policy.coarse, sweeps) if policy.coarse else None
    coarse_cue = coarse_cue and replace(coarse_cue, known_scenes=observations.known_scenes)
    data = LoadedDrive(used, observations, cues, coarse_cue, config.max_frames, recorded=whole)
    data = data.with_settings(config.refinement)
    # Copies of frames add no evidence.
    first_cue = data.first_cue
    if copies := set(copied_frames(first_cue.scenes, [image.classes for image in first_cue.images])):
        kept = [index for index in range(first_cue.num_frames) if index not in copies]
        data = replace(data.of_frames(kept), num_copies=len(copies))
    note = _describe(data, len(whole.frames))
    if config.cues == AUTO and not is_default(cues):
        note += ", the best its files allow"
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
    note = f"{num_used}{chosen} {frames}, {num_points:,} points"
    if is_default(data.cues):  # the classes of other cues are steps and gradients, which are nobody's
        note += (
            f", {len(observations.point_class_names)} point classes, "
            f"{len(observations.image_class_names)} image classes"
        )
    if data.num_copies:
        note += f", {data.num_copies} copies left out"
    if not is_default(data.cues):
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
