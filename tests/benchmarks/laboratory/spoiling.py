"""Drives with the faults of real recordings. Each function spoils a good drive at random; its docstring says how."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from laboratory.label_errors import POINT_SHARE, imitate_network_pixels
from laboratory.raw_drive import Labels, RawDrive, RawFrame, transformed

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.class_ids import Classes
from semcal_cli.files.image_files import read_image
from semcal_cli.geometry.arrays import Pose, Vector
from semcal_cli.geometry.twists import displace, pose_at
from semcal_cli.synthetic.label_noise import mislabel

UNLABELLED = 0
"""Id of points and pixels without a class."""
TURN_DEG = (0.7, 1.0)
"""Smallest and largest angle by which the point cloud of a frame is rotated."""
SHIFT_PX = (3.0, 4.0)
"""Default of the smallest and the largest shift of the image labels."""
LEAK_DEG, LEAK_M = (0.5, 3.0), (0.05, 0.3)
"""Smallest and largest error of the transform that projects image labels onto the points."""


def wrong_labels(raw: RawDrive, rng: np.random.Generator, share: float) -> RawDrive:
    """A network gives a fraction of the points and pixels another class."""
    return _relabelled(raw, rng, share, partial(mislabel, share=share, rng=rng, unlabelled=UNLABELLED))


def labels_by_a_network(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """A network labels both sides: borders are off, blobs have wrong classes, and so have some points."""
    return _relabelled(raw, rng, POINT_SHARE, partial(imitate_network_pixels, rng=rng))


def _relabelled(
    raw: RawDrive, rng: np.random.Generator, point_share: float, relabel_image: Callable[..., Labels]
) -> RawDrive:
    """Mislabel a fraction of the points, and relabel each image, given its labels and all classes of pixels."""
    points = _ids([frame.point_labels for frame in raw.frames])
    pixels = _ids([frame.image_labels for frame in raw.frames])
    return raw.with_frames(
        replace(
            frame,
            point_labels=mislabel(frame.point_labels, point_share, points, rng, UNLABELLED),
            image_labels=relabel_image(frame.image_labels, classes=pixels),
        )
        for frame in raw.frames
    )


def knocked(
    raw: RawDrive,
    rng: np.random.Generator,
    angle_deg: float = 0.0,
    distance_m: float = 0.0,
    share: float | None = None,
) -> RawDrive:
    """Something hits the camera and rotates or moves it for the rest of the drive.

    Args:
        raw: The drive.
        rng: Random generator, for the direction.
        angle_deg: Angle of the rotation about a random axis.
        distance_m: Distance of the move in a random direction.
        share: Fraction of the frames after the knock; None draws the time of the knock between a quarter and three
            quarters of the drive.
    """
    num_frames = raw.num_frames
    if share is None:
        first = int(rng.integers(math.ceil(num_frames / 4), math.floor(3 * num_frames / 4) + 1))
    else:
        first = num_frames - max(round(share * num_frames), 1)
    change = np.concatenate(
        [distance_m * _direction(rng), math.radians(angle_deg) * _direction(rng)], dtype=np.float64
    )
    after = [frame.with_camera_at(pose_at(frame.T_camera_lidar, change)) for frame in raw.frames[first:]]
    return raw.with_frames([*raw.frames[:first], *after])


def as_it_is(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """The drive is not changed."""
    return raw


def clouds_turned(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Odometry or synchronisation is bad: each point cloud is rotated about the LiDAR by its own angle and axis."""

    def turned(frame: RawFrame) -> RawFrame:
        turn = np.concatenate([np.zeros(3), math.radians(rng.uniform(*TURN_DEG)) * _direction(rng)])
        T: Pose = pose_at(np.eye(4), turn)
        return replace(frame, points=transformed(T, frame.points))

    return raw.with_frames(turned(frame) for frame in raw.frames)


def images_late(
    raw: RawDrive, rng: np.random.Generator, late_s: float, speeds_m_s: tuple[float, float]
) -> RawDrive:
    """The rig drives along the LiDAR's x axis, and each image is taken later than its sweep.

    Args:
        raw: The drive.
        rng: Random generator, for the speed of each frame.
        late_s: Time from sweep to image, in seconds.
        speeds_m_s: Smallest and largest speed, in metres per second.
    """

    def ahead(frame: RawFrame) -> RawFrame:
        # The earlier sweep shows everything farther ahead, by the distance that the rig has moved since.
        way_m = late_s * rng.uniform(*speeds_m_s)
        return replace(frame, points=frame.points + np.array([way_m, 0.0, 0.0], np.float32))

    return raw.with_document(synchronization="unknown").with_frames(map(ahead, raw.frames))


def point_labels_from_images(
    raw: RawDrive, rng: np.random.Generator, *, is_by_a_network: bool = False
) -> RawDrive:
    """A tool labels each point by the pixel under it, through a wrong transform; points outside have no label.

    Args:
        raw: The drive.
        rng: Random generator, for the error of the transform.
        is_by_a_network: Whether a network labels the images first.
    """
    if is_by_a_network:
        raw = labels_by_a_network(raw, rng)
    off_deg, off_m = rng.uniform(*LEAK_DEG), rng.uniform(*LEAK_M)
    return projected_labels(raw, displace(raw.frames[0].T_camera_lidar, off_deg, off_m, rng))


def projected_labels(raw: RawDrive, T_camera_lidar: Pose) -> RawDrive:
    """Label each point by the pixel under it, through a transform (4, 4); points outside have no label."""
    camera = core_camera(raw.drive.camera)

    def labelled(frame: RawFrame) -> RawFrame:
        projected = core.project_points(camera, frame.points, T_camera_lidar)
        is_seen = np.isfinite(projected.ranges)
        last = np.array(frame.image_labels.shape[::-1]) - 1
        pixels = np.where(is_seen[:, None], projected.pixels, 0.0)
        column, row = np.rint(pixels).astype(np.int64).clip(0, last).T
        labels = np.where(is_seen, frame.image_labels[row, column], UNLABELLED).astype(np.uint8)
        return replace(frame, point_labels=labels)

    return raw.with_frames(map(labelled, raw.frames))


def point_labels_shifted(raw: RawDrive, rng: np.random.Generator, entries: int) -> RawDrive:
    """A converter is off by some entries: each point has the label of a neighbour in the file."""
    shift = entries * _sign(rng)
    return raw.with_frames(
        replace(frame, point_labels=np.roll(frame.point_labels, shift)) for frame in raw.frames
    )


def image_labels_shifted(
    raw: RawDrive, rng: np.random.Generator, step: int = 1, distance_px: tuple[float, float] = SHIFT_PX
) -> RawDrive:
    """Another tool resized all label images, or every second one: their labels are some pixels off.

    Args:
        raw: The drive.
        rng: Random generator, for the shift.
        step: 1 shifts the labels of all frames, 2 those of every second frame.
        distance_px: Smallest and largest shift.
    """
    reach = range(-math.floor(distance_px[1]), math.floor(distance_px[1]) + 1)
    shifts = [
        (down, right)
        for down in reach
        for right in reach
        if distance_px[0] <= math.hypot(down, right) <= distance_px[1]
    ]
    down, right = shifts[rng.integers(len(shifts))]
    first = int(rng.integers(step))
    return raw.with_frames(
        replace(frame, image_labels=_shifted(frame.image_labels, down, right))
        if place % step == first
        else frame
        for place, frame in enumerate(raw.frames)
    )


def image_labels_cropped(raw: RawDrive, rng: np.random.Generator, pixels: int) -> RawDrive:
    """Label images lack rows at the top and columns on the left; drive.yaml has their size and the old K."""
    camera = raw.drive.camera
    size = {"width": camera.width - pixels, "height": camera.height - pixels}
    cropped = raw.with_document(camera=camera.model_copy(update=size))
    return cropped.with_frames(
        replace(frame, image_labels=np.ascontiguousarray(frame.image_labels[pixels:, pixels:]))
        for frame in raw.frames
    )


def principal_point_wrong(
    raw: RawDrive, rng: np.random.Generator, cx_px: float = 0.0, cy_px: float = 0.0
) -> RawDrive:
    """The principal point in drive.yaml is wrong, as after an unrecorded crop."""
    return _with_intrinsics(raw, right=cx_px * _sign(rng), down=cy_px * _sign(rng))


def focal_length_wrong(raw: RawDrive, rng: np.random.Generator, share: float) -> RawDrive:
    """Only the focal length along x is wrong, as after the images were stretched."""
    return _with_intrinsics(raw, scale=1.0 + share * _sign(rng))


def zoom_wrong(raw: RawDrive, rng: np.random.Generator, share: float) -> RawDrive:
    """Both focal lengths are wrong by the same factor, as those of another lens of the same make."""
    return raw.with_document(camera=raw.drive.camera.zoomed(1.0 + share * _sign(rng)))


def clouds_scaled(raw: RawDrive, rng: np.random.Generator, scale: float) -> RawDrive:
    """The point clouds are in other units, or a driver multiplies the ranges by a wrong constant."""
    return raw.with_frames(
        replace(frame, points=(scale * frame.points).astype(np.float32)) for frame in raw.frames
    )


def one_frame_again(
    raw: RawDrive,
    rng: np.random.Generator,
    times: int,
    noise_m: float | None = None,
    *,
    is_renamed: bool = False,
) -> RawDrive:
    """A car waits at a red light: the drive is one frame, listed again and again.

    Args:
        raw: The drive, of which a random frame is taken.
        rng: Random generator.
        times: Number of copies.
        noise_m: Standard deviation of the noise of each copy's coordinates; None for exact copies.
        is_renamed: Whether exact copies have files of their own.
    """
    frame = raw.frames[rng.integers(raw.num_frames)]

    def copied(number: int) -> RawFrame:
        if noise_m is None:
            return replace(frame, name=f"{number:06d}") if is_renamed else frame
        noise = noise_m * rng.standard_normal(frame.points.shape)
        return replace(frame, name=f"{number:06d}", points=(frame.points + noise).astype(np.float32))

    return raw.with_frames(copied(number) for number in range(times))


def classes_merged(raw: RawDrive, rng: np.random.Generator, first: Sequence[int] | None = None) -> RawDrive:
    """The user merges all classes into two, in the same way on both sides.

    Args:
        raw: The drive, whose points and pixels have the same ids.
        rng: Random generator.
        first: Ids of the first class; random if None.
    """
    ids = _ids([labels for frame in raw.frames for labels in (frame.point_labels, frame.image_labels)])
    if first is None:
        order = rng.permutation(ids)
        first = order[: rng.integers(1, len(ids))].tolist()
    names = {"a": sorted(first), "b": [id_ for id_ in ids.tolist() if id_ not in first]}
    return raw.with_document(classes=Classes.model_validate({"points": names, "image": names}))


def images_mirrored(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """Half of the images are mirrored with their labels, as by an augmentation that was left on."""
    mirrored = set(rng.permutation(raw.num_frames)[: raw.num_frames // 2].tolist())
    return raw.with_frames(
        _mirrored(frame) if place in mirrored else frame for place, frame in enumerate(raw.frames)
    )


def image_of_another_moment(raw: RawDrive, rng: np.random.Generator) -> RawDrive:
    """One point cloud is paired with an image from another moment of the drive."""
    place = int(rng.integers(raw.num_frames))
    others = raw.unused or [*raw.frames[:place], *raw.frames[place + 1 :]]
    frames = list(raw.frames)
    frames[place] = frames[place].with_image_of(others[rng.integers(len(others))])
    return raw.with_frames(frames)


def _ids(labels: Sequence[Labels]) -> Labels:
    """List the ids that occur, sorted, without `UNLABELLED`."""
    counts = sum(np.bincount(each.ravel(), minlength=256) for each in labels)
    found: Labels = np.setdiff1d(np.flatnonzero(counts), [UNLABELLED]).astype(np.uint8)
    return found


def _direction(rng: np.random.Generator) -> Vector:
    vector = rng.standard_normal(3)
    return vector / float(np.linalg.norm(vector))


def _sign(rng: np.random.Generator) -> int:
    return 1 if rng.random() < 0.5 else -1


def _shifted(labels: Labels, down: int, right: int) -> Labels:
    """Shift a label image (H, W); its border is repeated."""
    height, width = labels.shape
    rows = np.clip(np.arange(height) - down, 0, height - 1)
    columns = np.clip(np.arange(width) - right, 0, width - 1)
    return labels[np.ix_(rows, columns)]


def _mirrored(frame: RawFrame) -> RawFrame:
    image = read_image(frame.image) if isinstance(frame.image, Path) else frame.image
    mirrored = None if image is None else image[:, ::-1].copy()
    return replace(frame, image_labels=frame.image_labels[:, ::-1].copy(), image=mirrored)


def _with_intrinsics(raw: RawDrive, scale: float = 1.0, right: float = 0.0, down: float = 0.0) -> RawDrive:
    """Multiply fx, and add to cx and cy."""
    (fx, _, cx), (_, fy, cy), last_row = raw.drive.camera.K
    K = ((scale * fx, 0.0, cx + right), (0.0, fy, cy + down), last_row)
    return raw.with_document(camera=raw.drive.camera.model_copy(update={"K": K}))
