"""Where the images of a rig place its cameras, if some of them were calibrated to a wrong maximum.

Each camera alone has many maxima near the right one, above all by edges of few sweeps. Images that overlap tell how the
cameras are placed relative to one another, so that the pose of any camera gives those of all others. What all cameras
together have of information there decides which one is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.checks.other_pose import check_rivals
from semcal_cli.config import ExactConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.events import Listener
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.many.rig.adjusted_calibration import adjusted_calibration
from semcal_cli.many.rig.further_lidar import first_cameras
from semcal_cli.many.rig.image_matching import ImagePair, fit_all, pair_images
from semcal_cli.many.rig.matched_images import AGREE_DEG, MatchedImages
from semcal_cli.many.rig.rig_data import RigData
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.many.rig.rig_estimate import RigEstimate
from semcal_cli.many.rig.rig_uncertainty import AdjustedSensor, adjusted_sensor
from semcal_cli.many.rig.shared_clouds import merge_overlapping
from semcal_cli.many.rig.ties import Tie
from semcal_cli.observations.cues.cue_table import choose_cues, policy_of
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.readable import figure
from semcal_cli.result.calibration_document import CalibrationDocument

BLOCK_PX = 4
"""Side of the blocks on which poses are compared, pixels: what images show is a few pixels off."""
NARROW_STARTS: dict[str, Any] = {
    "num_starts": (24, 12, 6, 4),
    "spread_deg": (0.3, 1.2),
    "spread_m": (0.05, 0.25),
    "farthest_deg": 2.0,
    "farthest_m": 0.5,
}
"""Starts around a pose that images show: from wrong poses of the cameras, it may be two degrees off
(`tests/benchmarks/image_matching.py`)."""
NUM_ROUNDS = 2
"""Number of estimates with cameras that are not trusted: one may agree with its images only once others have moved."""


class RigPlaces(NamedTuple):
    """Where cameras of a rig are by the pose of one of them, and what images show of the others."""

    anchor: str
    """The camera that is believed."""
    poses: dict[str, Pose]
    """T_camera_lidar (4, 4) of each camera that images tie to it, with its own."""

    @classmethod
    def by(cls, anchor: str, T_camera_lidar: Pose, shown: Sequence[MatchedImages]) -> RigPlaces:
        """Place all cameras that images tie to one of them, the surest ties first (Prim 1957)."""
        poses = {anchor: T_camera_lidar}
        ties = sorted(shown, key=lambda tie: tie.spread_deg)
        while (
            tie := next((tie for tie in ties if (tie.to in poses) != (tie.source in poses)), None)
        ) is not None:
            if tie.source in poses:
                poses[tie.to] = tie.pose @ poses[tie.source]
            else:
                poses[tie.source] = inverse(tie.pose) @ poses[tie.to]
        return cls(anchor, poses)

    def elsewhere(self, cameras: Mapping[str, CalibrationDocument]) -> dict[str, Pose]:
        """Select the places (4, 4) of the cameras that are not trusted, and were calibrated to another maximum."""
        return {
            name: T
            for name, T in self.poses.items()
            if not cameras[name].trusted and compare_poses(cameras[name].pose, T).rotation_deg > AGREE_DEG
        }


class RigImages:
    """The images of the cameras of the first LiDAR of a rig, matched where they overlap."""

    def __init__(self, data: RigData, cameras: Mapping[str, CalibrationDocument]) -> None:
        """Match the images.

        Args:
            data: The rig.
            cameras: Calibration of each camera that has one.
        """
        self.data, self.alone = data, first_cameras(data.rig, cameras)
        drives = {name: _used(data.drives[name], before) for name, before in self.alone.items()}
        self.matched = pair_images(drives, _poses(self.alone), data.sweeps)

    @staticmethod
    def check(data: RigData) -> None:
        """Check that poses of the cameras can be compared by their information.

        Raises:
            InputError: a camera is calibrated by feature vectors, which have none.
        """
        for name, drive in data.drives.items():
            policy = policy_of(choose_cues(data.config.cues, drive, data.sweeps))
            if any(cue.has_vectors for cue in policy.cues.values()):
                raise InputError(
                    f"{data.rig.path}: match_images: found feature vectors as the cue of {name}, which have no "
                    "information to compare poses by; leave match_images out, or choose another --cue"
                )

    def elsewhere(self) -> dict[str, InitialPose]:
        """Find the cameras that were calibrated to a wrong maximum, and where images place them.

        Raises:
            InputError: as `load`.
            CalibrationError: as `load`.
        """
        poses, pairs = _poses(self.alone), self.matched.pairs
        shown, starts = fit_all(pairs, poses), dict[str, InitialPose]()
        for group in tied_groups(shown):
            if any(tie.to in group and tie.is_contradicted_by(poses) for tie in shown):
                places = best_places(group, self.alone, pairs, shown, self._load)
                for name, T in places.elsewhere(self.alone).items():
                    starts[name] = InitialPose(T, f"the place by its images and {places.anchor}")
        return starts

    def load_near(self, name: str, on_event: Listener) -> LoadedDrive:
        """Load the drive of a camera, with narrow starts around where images place it.

        Raises:
            InputError: as `load`.
            CalibrationError: as `load`.
        """
        data = self.data.load(name, on_event=on_event)
        starts = data.observations.starts
        if starts is None:
            return data
        narrow = replace(starts, **NARROW_STARTS)
        return replace(data, observations=replace(data.observations, starts=narrow))

    def judged(self, name: str, again: CalibrationDocument) -> CalibrationDocument:
        """Note why a calibration was made again, and doubt it if the pose before explains the data as well.

        Args:
            name: The camera.
            again: Its calibration from where images place it.
        """
        before = self.alone[name]
        away = compare_poses(before.pose, again.pose)
        note = (
            f"calibrated again from {again.settings.options['given']}, it ended {figure(away.rotation_deg)} degrees "
            f"and {figure(away.camera_center_cm)} cm from where it had alone"
        )
        changes: dict[str, object] = {"notes": (*again.notes, note)}
        if again.trusted and (doubt := self._doubt(name, again)) is not None:
            reason, topic = doubt
            changes |= {"status": "not_trusted", "reasons": (reason,), "topics": (topic,)}
        return again.model_copy(update=changes)

    def _doubt(self, name: str, again: CalibrationDocument) -> tuple[str, str] | None:
        """Return the reason, and its topic, by which the pose before speaks against a trusted one; None without one."""
        before, uncertainty = self.alone[name].pose, again.uncertainty
        seen = self.data.seen(name, again, again.pose)
        (measured,) = check_rivals(seen, again.pose, uncertainty, known=[before])
        offsets = np.abs(compare_poses(before, again.pose).offsets)
        if uncertainty is not None and (offsets <= uncertainty.half_widths).all():
            reason = "it ended where it had alone, which its images contradict: add frames from other places"
            return reason, measured.topic
        return None if measured.finding is None else (measured.finding.sentence, measured.topic)

    def settle(self, cameras: dict[str, CalibrationDocument]) -> tuple[MatchedImages, ...]:
        """Move cameras that are not trusted to what they and their images say together.

        Trusted cameras take part by their covariance, and stay where they are.

        Args:
            cameras: Calibration of each camera that has one; those that are moved are replaced.

        Returns:
            What images show of each two cameras.

        Raises:
            InputError: as `load`.
            CalibrationError: as `load`.
        """
        current = {name: cameras[name] for name in self.alone}
        drives = {name: _used(self.data.drives[name], each) for name, each in current.items()}
        if any(drives[name] != _used(self.data.drives[name], before) for name, before in self.alone.items()):
            self.matched = pair_images(drives, _poses(current), self.data.sweeps)
        poses = _poses(current)
        own = {
            name: Tie.of_calibration(name, FIRST_LIDAR, each, even_doubted=True)
            for name, each in current.items()
        }
        known = {name: tie for name, tie in own.items() if tie is not None}
        for _ in range(NUM_ROUNDS):
            sensors = dict[str, AdjustedSensor]()
            shown = fit_all(self.matched.pairs, poses)
            agreeing = [
                tie
                for tie in shown
                if {tie.to, tie.source} <= known.keys() and not tie.is_contradicted_by(poses)
            ]
            for group in tied_groups(agreeing):
                ties = [Tie.of_images(tie) for tie in agreeing if tie.to in group]
                estimate = RigEstimate.fit([*(known[name] for name in group), *ties])
                doubted = [name for name in group if not current[name].trusted]
                sensors |= {name: adjusted_sensor(name, estimate) for name in doubted}
                poses |= {name: sensors[name].pose for name in doubted}
        for name, sensor in sensors.items():
            seen = self.data.seen(name, current[name], sensor.pose)
            cameras[name] = adjusted_calibration(current[name], seen, sensor, "overlapping images")
        return tuple(shown)

    def _load(self, name: str) -> LoadedDrive:
        return self.data.load(name, self.alone[name])


def _poses(cameras: Mapping[str, CalibrationDocument]) -> dict[str, Pose]:
    return {name: calibration.pose for name, calibration in cameras.items()}


def _used(drive: Drive, calibration: CalibrationDocument) -> Drive:
    """Return a drive with the camera, the clock and the frames of its calibration."""
    used = {frame.points for frame in calibration.input.frames}
    frames = [at for at, frame in enumerate(drive.frames) if frame.points in used]
    return with_frames(calibration.applied_to(drive), frames)


def tied_groups(shown: Sequence[MatchedImages]) -> list[list[str]]:
    """Group the cameras that images tie, directly or through others."""
    ties = ([tie.source, tie.to] for tie in shown)
    merged = merge_overlapping((ends, set[Hashable](ends)) for ends in ties)
    return [list(dict.fromkeys(names)) for names, _ in merged]


def best_places(
    names: Collection[str],
    cameras: Mapping[str, CalibrationDocument],
    pairs: Sequence[ImagePair],
    shown: Sequence[MatchedImages],
    load: Callable[[str], LoadedDrive],
) -> RigPlaces:
    """Choose the camera whose pose gives all cameras that images tie the most information.

    Only trusted ones are candidates if there are any. The images are then compared again with the cameras where the
    chosen one places them: how far features are away depends a little on the poses.

    Args:
        names: Cameras that images tie.
        cameras: Calibration of each.
        pairs: Their images, matched.
        shown: What these show.
        load: Loads the drive of a camera; one at a time is held.

    Raises:
        InputError: a file is missing or wrong.
    """
    trusted = [name for name in names if cameras[name].trusted]
    by_anchor = {name: RigPlaces.by(name, cameras[name].pose, shown) for name in trusted or names}
    nats = dict.fromkeys(by_anchor, 0.0)
    for name in names:
        poses = [places.poses[name] for places in by_anchor.values()]
        observations = load(name).observations.along_scans(cameras[name].pose)
        for anchor, gained in zip(by_anchor, _information(observations, poses), strict=True):
            nats[anchor] += gained
    best = by_anchor[max(nats, key=lambda anchor: nats[anchor])]
    again = fit_all([pair for pair in pairs if {pair.to, pair.source} <= {*names}], best.poses)
    placed = RigPlaces.by(best.anchor, best.poses[best.anchor], again)
    return RigPlaces(best.anchor, best.poses | placed.poses)


def _information(observations: Observations, poses: Sequence[Pose]) -> list[float]:
    """Compute the information of all points at poses (4, 4), nats; with a sign if the starts have a contrast."""
    starts = observations.starts
    ends = core.align(
        observations.core,
        poses,
        ExactConfig(steps=0),
        factor=BLOCK_PX,
        visible_only=True,
        seed=0,
        is_signed=starts is not None and starts.contrast is not None,
    )
    return [end.value * end.num_points for end in ends]
