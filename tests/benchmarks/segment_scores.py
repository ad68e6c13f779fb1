"""Compare scores of segments and image labels on real drives, along six axes through the published pose.

    python tests/benchmarks/segment_scores.py ../shared/data -o docs/pictures/segment_scores.png

Three scores: mutual information; the uncertainty coefficient, which is that over the entropy of the labels under the
points; and the adjusted mutual information, which `--cue segments` maximises. The image shows each less its value at
the published pose, over its own range. The table says where each is largest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, table
from profiles import AXES, draw_profiles, profiles
from real_data import real_drives

from semcal_cli import core
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.segments import SEGMENTS
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import NO_CLASS, Observations

SCORES = ("mutual information", "uncertainty coefficient", "adjusted mutual information")
DRIVES = ("KITTI jam, 13 pairs", "OpenCalib 1", "OpenCalib 3", "nuScenes back")


class Scores:
    """The scores of a drive, of the points that are visible at one pose."""

    def __init__(self, observations: Observations, T_camera_lidar: Pose) -> None:
        self.observations, self.camera = observations, core_camera(observations.camera)
        clouds = [cloud.points for cloud in observations.clouds]
        self.segments = core.segment_sweeps(clouds, SEGMENTS.segmentation)
        self.seen = []
        for points, segments in zip(clouds, self.segments, strict=True):
            projected = core.project_points(self.camera, points, T_camera_lidar)
            is_seen = np.isfinite(projected.ranges) & ~projected.is_hidden
            self.seen.append(np.flatnonzero(is_seen & (segments.ids != core.NO_SEGMENT)))

    def at(self, T_camera_lidar: Pose) -> tuple[float, float, float]:
        """The three scores: nats, and shares."""
        joints = []
        observed = self.observations.frame_observations
        for frame, segments, seen in zip(observed, self.segments, self.seen, strict=True):
            projected = core.project_points(self.camera, frame.cloud.points[seen], T_camera_lidar)
            inside = np.isfinite(projected.ranges)
            columns, rows = np.round(projected.pixels[inside]).astype(int).T
            height, width = frame.image.classes.shape
            labels = frame.image.classes[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
            joint = np.zeros((segments.num_segments, NO_CLASS + 1))
            np.add.at(joint, (segments.ids[seen][inside], labels), 1.0)
            joints.append(joint[:, :NO_CLASS])
        joint = np.concatenate(joints)
        joint /= joint.sum()
        entropy = _entropy(joint.sum(axis=0))
        information = entropy + _entropy(joint.sum(axis=1)) - _entropy(joint)
        adjusted = information_by_squares(self.observations, T_camera_lidar).mean
        return information, information / entropy, adjusted


def _entropy(shares: np.ndarray) -> float:
    positive = shares[shares > 0.0]
    return float(-(positive * np.log(positive)).sum())


def main(data: Path, *, output: Path, steps: int = 8, only: str = "", max_frames: int = 70) -> Iterator[str]:
    """Draw the profiles, `steps` poses to either side, and print where each score is largest along each axis."""
    curves = {}
    with TemporaryDirectory() as folder:
        for real in real_drives(data.resolve(), Path(folder)):
            if real.name in DRIVES and only in real.name:
                drive, T = read_drive(real.path), read_transform(real.path)
                drive = with_frames(drive, range(min(max_frames, len(drive.frames))))
                scores = Scores(load(drive, CalibrationConfig(cues=("segments",))).observations, T)
                along = profiles(scores.at, T, steps)
                curves[real.name] = {
                    score: [(offsets, found[:, index]) for offsets, found in along]
                    for index, score in enumerate(SCORES)
                }
    rows = [
        (name, score, *(f"{offsets[np.argmax(found)]:+.2g}" for offsets, found in along))
        for name, by_score in curves.items()
        for score, along in by_score.items()
    ]
    yield from table(f"drive | score | {' | '.join(AXES)}", rows)
    draw_profiles(curves, output, head=1.0, linewidth=1.4)
    yield f"written to {output}"


if __name__ == "__main__":
    script(main)
