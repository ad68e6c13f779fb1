"""Sweeps that fit together, as one cloud for each image.

Sweeps of a rig that stands are put together as they are, and those of one that moves are moved by its poses or its
twist. Nothing is taken on trust: the surfaces of each sweep have to lie on those of the sweep with the image.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, Progress
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.geometry.arrays import Points, RawIds, Values, Vector
from semcal_cli.geometry.poses import rotation_error_deg
from semcal_cli.importing.lines_of_sight import are_seen, are_unmoved
from semcal_cli.importing.sweep_agreement import Surfaces
from semcal_cli.observations.motion import displacement, read_trajectory
from semcal_cli.observations.point_times import checked_times

MAX_STANDING_M, MAX_STANDING_DEG = 0.02, 0.2
"""How far sweeps of a rig that stands may seem to be apart: the range noise of a Livox Mid-360, 2 cm at 10 m, and about
its 0.15 degrees (its data sheet). In a synthetic street, sweeps of 9,000 points seem to be up to 1.3 cm and 0.08
degrees apart, and of pairs with 3,700 points 4 % are beyond the limits."""
MIN_STANDING_S = 1.0
"""A rig stands if sweeps over this time are within these limits: it then moves by less than 2 cm/s."""
MAX_MISFITS = 2
"""A cloud ends where so many sweeps in a row do not fit: a single one may seem to be apart by chance."""
MAX_CORRECTION_M, MAX_CORRECTION_DEG = 0.3, 1.0
"""How far a sweep may be from where a motion puts it, to be moved the rest of the way onto the surfaces. Larger
displacements are not found for certain, and show a wrong motion."""
MIN_SHARE_NEAR = 0.5
"""Smallest share of the points, along any direction, that lie on the surfaces of the sweep with the image. It is 0.56
to 0.77 on three drives of KITTI raw at 7 to 9 m/s by their poses, up to 0.4 s apart, and without them at most 0.42
where a displacement within the limits is found."""
NEEDED_MOTION = "expected `motion:`, which `semcal odometry` or --odometry at import estimates"


class AccumulatedCloud(NamedTuple):
    """The sweeps of one frame as one cloud."""

    points: Points
    """(N, 3 or 4) x, y, z in metres in the LiDAR frame at `points_stamp`, and the intensity, if sweeps have one."""
    labels: RawIds | None
    """(N,) ids of the points."""
    num_points: int
    num_read: int
    num_sweeps: int
    num_moving: int
    num_hidden: int
    distance_m: float
    stood: bool
    """Whether the rig stood still for a while, also when the image was taken."""
    place: int
    """Place of the image's sweep among all."""

    def files(self, name: str) -> dict[str, tuple[str, bytes]]:
        """Return the names and the contents of its files, by their keys in a drive.yaml."""
        files = {"points": (f"points/{name}.bin", self.points.astype("<f4").tobytes())}
        if self.labels is not None:
            files["point_labels"] = (f"point_labels/{name}.label", self.labels.astype("<u4").tobytes())
        return files


class _Sweep(NamedTuple):
    """A sweep in the frame of another."""

    frame: Frame
    cloud: SweepCloud
    points: Points
    """(N, 3) metres, in the LiDAR frame at the other's stamp."""
    origin_m: Vector
    """(3,) where its rays start, in that frame."""
    distance_m: float
    """How far it was from the other, as far as a motion did not tell."""


class _MisfitError(Exception):
    """A sweep that cannot be put together with another, with the reason."""


class Accumulation:
    """Puts the sweeps of a drive together, those of one frame at a time."""

    def __init__(
        self, drive: Drive, seconds: float | None, num_sweeps: int | None, on_event: Listener
    ) -> None:
        self.drive, self.on_event = drive, on_event
        self.left_out: Counter[str] = Counter()
        """Number of frames with an image whose sweep fits no other, by reason."""
        self.num_sharing = 0
        """Number of frames with an image whose sweep became part of another one's cloud."""
        self.has_intensity: bool | None = None
        """Whether sweeps have intensities; None before the first is read."""
        self._origin_m = np.array(drive.origin_m)
        """(3,) where the rays of a sweep start, metres, LiDAR frame."""
        self._motion = drive.motion
        if self._motion is not None and self._motion.speed_m_s is not None:
            if self._motion.speed_m_s > 0.0:
                raise InputError(f"{drive.path}: motion: found a speed without a direction, {NEEDED_MOTION}")
            self._motion = None
        self._trajectory: core.Trajectory | None = None
        if self._motion is not None and self._motion.poses is not None:
            self._trajectory = read_trajectory(drive, self._motion.poses)
        self._sweeps, self._places, self._length = self._in_order(seconds, num_sweeps)

    def clouds(self) -> Iterator[tuple[Frame, AccumulatedCloud]]:
        """Yield the cloud of each frame with an image that is kept, and the frame."""
        place_of = {frame.points: place for place, frame in enumerate(self._sweeps)}
        images = [frame for frame in self.drive.frames if frame.image or frame.image_labels]
        if not images:
            raise InputError(f"{self.drive.path}: found no frame with an image or label image")
        places = sorted((place_of[frame.points], index) for index, frame in enumerate(images))
        free = [(0, len(self._sweeps))]
        while free:
            start, stop = free.pop()
            left = [(place, index) for place, index in places if start <= place < stop]
            if not left:
                continue
            # The image nearest to the middle of the sweeps that follow has as many of them before it as after.
            middle = self._places[start] + 0.5 * self._length
            place, index = min(left, key=lambda image: abs(self._places[image[0]] - middle))
            num_left = sum(end - begin for begin, end in (*free, (start, stop)))
            self.on_event(Progress("accumulating sweeps", len(self._sweeps) - num_left, len(self._sweeps)))
            fitted = self._around(place, start, stop)
            # What is before the cloud comes next, then what is after it.
            free += [(max(fitted, default=place) + 1, stop), (start, min(fitted, default=place))]
            if fitted:
                taken = [image for image, _ in left if min(fitted) <= image <= max(fitted)]
                self.num_sharing += len(taken) - 1
                yield images[index], self._merged(images[index], place, fitted)

    def refusal(self) -> InputError:
        """Make the error of a drive no two of whose sweeps can be put together."""
        reason, _ = self.left_out.most_common(1)[0]
        return InputError(f"{self.drive.path}: {reason}")

    def _in_order(
        self, seconds: float | None, num_sweeps: int | None
    ) -> tuple[list[Frame], list[float], float]:
        """Sort the sweeps by time, where all have stamps; return them, their places in time or number, and a length."""
        sweeps = list({frame.points: frame for frame in reversed(self.drive.frames)}.values())[::-1]
        unstamped = next((frame for frame in sweeps if frame.points_stamp is None), None)
        if unstamped is None:
            sweeps.sort(key=_stamp_s)
        elif num_sweeps is None or self._motion is not None:
            needed = "a time for the motion" if self._motion is not None else "a time, or --sweeps"
            raise InputError(
                f"{self.drive.path}: {unstamped.key('points_stamp')}: found nothing, expected {needed}"
            )
        if num_sweeps is not None:
            return sweeps, [float(place) for place in range(len(sweeps))], num_sweeps - 1.0
        assert seconds is not None
        return sweeps, [_stamp_s(frame) for frame in sweeps], seconds

    def _around(self, place: int, start: int, stop: int) -> dict[int, _Sweep]:
        """Put the sweeps nearest to one of them together with it, of those from `start` on and before `stop`.

        Returns:
            The sweeps by their places; none if no other fits.
        """
        key = self._sweeps[place]
        cloud = self._read(key)
        try:
            own = self._moved(key, cloud, key)
        except _MisfitError as misfit:
            self.left_out[str(misfit)] += 1
            return {}
        surfaces = Surfaces(own.points)
        if self._motion is None and not surfaces.fix_a_position:
            self.left_out[
                f"found {Path(key.points).name}, whose surfaces do not face all directions, so that they cannot show "
                f"that the rig stands, {NEEDED_MOTION}"
            ] += 1
            return {}
        fitted, misfits = {place: own}, dict[int, list[str]]({-1: [], 1: []})
        sides = {-1: place - 1, 1: place + 1}
        while sides:
            step = min(sides, key=lambda step: self._distance(sides[step], place, start, stop))
            other = sides[step]
            span = self._span([*fitted, other]) if start <= other < stop else np.inf
            if span > self._length * (1.0 + 1e-9) + 1e-6:
                del sides[step]
                continue
            sides[step] = other + step
            try:
                fitted[other] = self._fitted(self._sweeps[other], key, surfaces, cloud)
                misfits[step].clear()
            except _MisfitError as misfit:
                misfits[step].append(str(misfit))
                if len(misfits[step]) == MAX_MISFITS:
                    del sides[step]
        if len(fitted) == 1:
            reasons = [*misfits[-1], *misfits[1]]
            none = f"found no other sweep near {Path(key.points).name} in time, expected more seconds or more sweeps"
            self.left_out[reasons[0] if reasons else none] += 1
            return {}
        return {other: fitted[other] for other in sorted(fitted)}

    def _distance(self, other: int, place: int, start: int, stop: int) -> float:
        """Return how far a sweep is from the one at a place; infinite where there is none."""
        if not start <= other < stop:
            return np.inf
        return abs(self._places[other] - self._places[place])

    def _span(self, places: Sequence[int]) -> float:
        return self._places[max(places)] - self._places[min(places)]

    def _read(self, frame: Frame) -> SweepCloud:
        labels = None if frame.point_labels is None else self.drive.resolve(frame.point_labels)
        file = self.drive.resolve(frame.points)
        (cloud,) = read_point_clouds([(file, labels)], self.drive.max_points, self.drive.point_form)
        if cloud.label_shares is not None:
            raise InputError(f"{labels}: found probabilities of classes, expected ids to accumulate")
        has_intensity = cloud.intensity is not None
        if self.has_intensity is None:
            self.has_intensity = has_intensity
        if has_intensity != self.has_intensity:
            known = "an intensity" if has_intensity else "no intensity"
            raise InputError(f"{file}: found {known}, unlike in other sweeps, expected one in all or in none")
        return cloud

    def _fitted(self, frame: Frame, key: Frame, surfaces: Surfaces, key_cloud: SweepCloud) -> _Sweep:
        """Read a sweep and put it into the frame of the key's.

        Raises:
            _MisfitError: it does not lie on the surfaces of the key's sweep.
        """
        cloud = self._read(frame)
        if (cloud.labels is None) != (key_cloud.labels is None):
            lacking = frame if cloud.labels is None else key
            raise InputError(
                f"{self.drive.path}: {lacking.key('point_labels')}: found nothing, expected labels of all sweeps or "
                "none"
            )
        sweep = self._moved(frame, cloud, key)
        displaced = surfaces.displacement(sweep.points)
        names = f"{Path(frame.points).name} and {Path(key.points).name}"
        if displaced is None:
            raise _MisfitError(
                f"found {names}, which have no surfaces in common, expected sweeps of one place"
            )
        T, moves = displaced.T, self._motion is not None
        distance_m, angle_deg = float(np.linalg.norm(T[:3, 3])), rotation_error_deg(T, np.eye(4))
        limits = (MAX_CORRECTION_M, MAX_CORRECTION_DEG) if moves else (MAX_STANDING_M, MAX_STANDING_DEG)
        if distance_m > limits[0] or angle_deg > limits[1] or displaced.share_near < MIN_SHARE_NEAR:
            apart = f"{100.0 * distance_m:.1f} cm and {angle_deg:.2f} deg apart"
            if displaced.share_near < MIN_SHARE_NEAR:
                apart = f"of which {displaced.share_near:.0%} of the points lie on the same surfaces"
            if moves:
                raise _MisfitError(
                    f"motion: found {names}, {apart} after it, expected a motion that fits the sweeps"
                )
            raise _MisfitError(f"found {names}, {apart}: the rig moves, {NEEDED_MOTION}")
        if moves:
            points = (sweep.points @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
            sweep = sweep._replace(points=points, origin_m=T[:3, :3] @ sweep.origin_m + T[:3, 3])
        return sweep._replace(distance_m=distance_m)

    def _moved(self, frame: Frame, cloud: SweepCloud, key: Frame) -> _Sweep:
        """Move a sweep by the motion of the drive to the stamp of the key's.

        Raises:
            _MisfitError: the motion does not cover it.
        """
        motion = self._motion
        if motion is None:
            return _Sweep(frame, cloud, cloud.points, self._origin_m, 0.0)
        start_s, end_s = _stamp_s(frame), _stamp_s(key)
        told = checked_times(self.drive, frame, cloud, motion.point_times)
        times_s = np.full(len(cloud.points), start_s)
        if told is not None:
            times_s = told[0] + (0.0 if told[1] else start_s)
        trajectory = self._trajectory
        if trajectory is None:
            assert motion.twist is not None
            trajectory = core.Trajectory.constant(
                (*motion.twist.linear_m_s, *motion.twist.angular_rad_s), end_s
            )
        try:
            points = trajectory.compensate(cloud.points, times_s, end_s)
            T = displacement(trajectory, end_s, 0.5 * float(times_s.min() + times_s.max()))
        except ValueError as error:
            raise _MisfitError(f"motion: {error}, expected poses before and after {frame.points}") from None
        return _Sweep(frame, cloud, points, T[:3, :3] @ self._origin_m + T[:3, 3], 0.0)

    def _merged(self, key: Frame, place: int, fitted: Mapping[int, _Sweep]) -> AccumulatedCloud:
        """Put sweeps together, without what moves, and without what the key's own origin does not see."""
        sweeps = list(fitted.values())
        points, origins = [sweep.points for sweep in sweeps], [sweep.origin_m for sweep in sweeps]
        num_read = sum(map(len, points))
        if num_read > self.drive.max_points:
            raise InputError(
                f"{self.drive.path}: found {num_read:,} points of {len(sweeps):,} sweeps, needed at most "
                f"{self.drive.max_points:,}: accumulate fewer sweeps"
            )
        rows = np.concatenate(points).astype(np.float32)
        if self.has_intensity:
            rows = np.hstack([rows, np.concatenate([_intensity(sweep.cloud) for sweep in sweeps])])
        labels = None
        if sweeps[0].cloud.labels is not None:
            labels = np.concatenate([sweep.cloud.labels for sweep in sweeps])
        keeps = are_unmoved(points, origins)
        num_moving = num_read - int(keeps.sum())
        if len(np.unique(origins, axis=0)) > 1:
            keeps[keeps] = are_seen(rows[keeps, :3], self._origin_m)
        rows = rows[keeps]
        return AccumulatedCloud(
            rows,
            None if labels is None else labels[keeps],
            len(rows),
            num_read,
            len(sweeps),
            num_moving,
            num_read - num_moving - len(rows),
            float(np.median([sweep.distance_m for sweep in sweeps])),
            self._motion is None and self._stood(key, sweeps),
            place,
        )

    def _stood(self, key: Frame, sweeps: Sequence[_Sweep]) -> bool:
        """Return whether the sweeps span `MIN_STANDING_S`, and the image was taken among them."""
        stamps_s = [sweep.frame.points_stamp for sweep in sweeps]
        known_s = [stamp_s for stamp_s in stamps_s if stamp_s is not None]
        if len(known_s) < len(stamps_s) or max(known_s) - min(known_s) < MIN_STANDING_S:
            return False
        image_s = key.points_stamp if key.image_stamp is None else key.image_stamp + self.drive.time_offset_s
        assert image_s is not None
        return min(known_s) <= image_s <= max(known_s) + (self.drive.sweep_gap_s or 0.0)


def _stamp_s(frame: Frame) -> float:
    assert frame.points_stamp is not None
    return frame.points_stamp


def _intensity(cloud: SweepCloud) -> Values:
    """Return the intensities (N, 1) of a sweep that has them."""
    assert cloud.intensity is not None
    return cloud.intensity.astype(np.float32)[:, None]
