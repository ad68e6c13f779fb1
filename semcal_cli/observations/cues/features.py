"""The features cue: feature vectors of points and pixels, as computed by networks, instead of labels.

The meaning of the vectors is unknown, and the two sides need not have anything in common. Vectors have no histogram, so
MINE bounds their mutual information (`refine.mine`). The initial calibration replaces each vector by the nearest of
several centres (k-means) and uses the histogram of these codes.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import CalibrationError, InputError, counted
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.input_files import map_array
from semcal_cli.files.point_clouds import PER_POINT, SweepCache, max_bytes
from semcal_cli.geometry.arrays import Features
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.observations import LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import make_observations, read_clouds
from semcal_cli.threads import thread_pool

SAMPLES = 20_000
"""Number of vectors from which the centres are computed."""
MAX_CHANNELS = 4096


@dataclass(frozen=True)
class FeaturesConfig:
    """How feature vectors become codes (k-means)."""

    num_codes: int = 24
    """Number of codes, which take the place of classes."""
    iterations: int = 20
    """Iterations of k-means."""


FEATURES = FeaturesConfig()


def observe_features(
    drive: Drive, sweeps: SweepCache | None = None, is_raw: bool = False, config: FeaturesConfig = FEATURES
) -> Observations:
    """Load every frame of a drive with its features, scaled to unit variance, and with their codes as classes.

    Each frame needs features of points and of pixels. Raw ones are the same.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: the features of the points or of the pixels are all the same.
    """
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    point_features = [_of_points(drive, *pair) for pair in zip(drive.frames, clouds, strict=True)]
    image_features = [_of_image(drive, frame) for frame in drive.frames]
    for key, vectors in (("point_features", point_features), ("image_features", image_features)):
        for frame, frame_features in zip(drive.frames, vectors, strict=True):
            if frame_features.shape[-1] != vectors[0].shape[-1]:
                where = drive.resolve(str(getattr(frame, key)))
                raise InputError(
                    f"{where}: found {counted(frame_features.shape[-1], 'channel')}, needed {vectors[0].shape[-1]}"
                )
    labelled = [
        LabelledCloud(sweep.points, codes, vectors=scaled)
        for sweep, (scaled, codes) in zip(moved, _coded("points", point_features, config), strict=True)
    ]
    images = []
    for scaled, codes in _coded("pixels", image_features, config):
        block = drive.camera.width // scaled.shape[1]
        images.append(LabelledImage(codes.repeat(block, axis=0).repeat(block, axis=1), vectors=scaled))
    names = [str(code) for code in range(config.num_codes)]
    return make_observations(drive, clouds, moved, labelled, images, (names, names))


def _of_points(drive: Drive, frame: Frame, cloud: SweepCloud) -> Features:
    """Read the features (N, C) of a cloud's returns; the file has a row for every entry of the cloud."""
    path, vectors = _read(drive, frame, "point_features")
    count = len(cloud.is_kept)
    if vectors.ndim != 2 or len(vectors) != count:
        raise InputError(
            f"{path}: found shape {vectors.shape}, needed ({count}, C): {frame.points} has {count} points"
        )
    return vectors[cloud.is_kept]


def _of_image(drive: Drive, frame: Frame) -> Features:
    """Read the features (H / s, W / s, C) of an image, at 1 / s of its size."""
    path, vectors = _read(drive, frame, "image_features")
    height, width = drive.camera.height, drive.camera.width
    rows, columns = vectors.shape[:2] if vectors.ndim == 3 else (0, 0)
    if not rows or not columns or width % columns or height % rows or width // columns != height // rows:
        needed = f"({height}, {width}, C), or both sides divided by the same whole number"
        raise InputError(f"{path}: found shape {vectors.shape}, needed {needed}")
    return vectors


def _read(drive: Drive, frame: Frame, key: str) -> tuple[Path, Features]:
    path = drive.file_of(frame, key, "a .npy file of features")
    if drive.arrays is None:
        vectors = map_array(path, max_bytes(drive.max_points), PER_POINT)
    else:
        vectors = drive.arrays.by_name[getattr(frame, key)]
    if vectors.dtype.kind not in "fiu":
        raise InputError(f"{path}: found {vectors.dtype}, expected an array of numbers")
    if not vectors.ndim or not 1 <= vectors.shape[-1] <= MAX_CHANNELS:
        raise InputError(f"{path}: found shape {vectors.shape}, needed 1 to {MAX_CHANNELS} channels")
    return path, vectors


def _coded(
    side: str, vectors: Sequence[Features], config: FeaturesConfig
) -> list[tuple[Features, npt.NDArray[np.uint8]]]:
    """Scale each channel to unit variance over all frames, and code each vector by its nearest centre."""
    from scipy.cluster.vq import kmeans2, vq

    rng = np.random.default_rng(0)
    share = max(1, SAMPLES // len(vectors))
    flat = [frame_features.reshape(-1, frame_features.shape[-1]) for frame_features in vectors]
    some = np.concatenate([rows[rng.integers(len(rows), size=share)] for rows in flat]).astype(np.float64)
    if not np.isfinite(some).all():
        raise InputError(f"features of {side}: found values that are not finite, expected numbers")
    mean, spread = some.mean(axis=0), some.std(axis=0)
    if not (spread > 0.0).any():
        raise CalibrationError(f"features of {side} are all the same: they say nothing about the pose")
    spread[spread == 0.0] = 1.0
    some = (some - mean) / spread
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # A centre that is nearest to no vector stays where it is.
        centres, _ = kmeans2(
            some, some[rng.permutation(len(some))[: config.num_codes]], config.iterations, minit="matrix"
        )

    def coded(frame_features: Features) -> tuple[Features, npt.NDArray[np.uint8]]:
        scaled = ((frame_features - mean) / spread).astype(np.float16)
        if not np.isfinite(scaled).all():
            raise InputError(f"features of {side}: found values that are not finite, expected numbers")
        codes, _ = vq(scaled.reshape(-1, scaled.shape[-1]).astype(np.float32), centres.astype(np.float32))
        return scaled, codes.astype(np.uint8).reshape(scaled.shape[:-1])

    with thread_pool() as pool:
        return list(pool.map(coded, vectors))


CUE = Cue(
    observe=observe_features,
    files=("point_features", "image_features"),
    config=FEATURES,
    has_vectors=True,
)
