"""Compare scores of segments and picture labels on real drives, along six axes through the published pose.

    python tests/benchmarks/segment_scores.py ../shared/data -o docs/pictures/segment_scores.png

Three scores: mutual information; the uncertainty coefficient, which is that over the entropy of the labels under the
points; and the adjusted mutual information, which `--cue segments` maximises. The picture shows each less its value at
the published pose, over its own range. The table says where each is largest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from profiles import AXES, Profile, draw_profiles, poses_along
from real_data import real_drives

from semcal_cli import _core
from semcal_cli.assessment.information import information_by_squares
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.cues.segments import SEGMENTS
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.drive.observations import NO_CLASS
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose

SCORES = ("mutual information", "uncertainty coefficient", "adjusted mutual information")
DRIVES = ("KITTI jam, 13 pairs", "OpenCalib 1", "OpenCalib 3", "nuScenes back")


class Profiles:
    """The scores of a drive, of the points that are visible at one pose."""

    def __init__(self, data: LoadedDrive, T_camera_lidar: Pose) -> None:
        """Choose the points."""
        self.observations, self.T = data.observations, T_camera_lidar
        self.camera = core_camera(data.drive.camera)
        self.segments = _core.segment_sweeps(
            [cloud.points for cloud in self.observations.clouds], SEGMENTS.segmentation
        )
        self.seen = []
        for cloud, segments in zip(self.observations.clouds, self.segments, strict=True):
            projected = _core.project_points(self.camera, cloud.points, T_camera_lidar)
            is_seen = np.isfinite(projected.ranges) & ~projected.is_hidden
            self.seen.append(np.flatnonzero(is_seen & (segments.ids != _core.NO_SEGMENT)))

    def at(self, T_camera_lidar: Pose) -> tuple[float, float, float]:
        """Give the three scores: nats, and shares."""
        information, entropy = self._plug_in(T_camera_lidar)
        return (
            information,
            information / entropy,
            information_by_squares(self.observations, T_camera_lidar).mean,
        )

    def _plug_in(self, T_camera_lidar: Pose) -> tuple[float, float]:
        """Mutual information of segments and labels, and the entropy of the labels, nats."""
        joints = []
        observed = self.observations.frame_observations
        for frame, segments, seen in zip(observed, self.segments, self.seen, strict=True):
            projected = _core.project_points(self.camera, frame.cloud.points[seen], T_camera_lidar)
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
        return entropy + _entropy(joint.sum(axis=1)) - _entropy(joint), entropy

    def along(self, axis: int, steps: int) -> Profile:
        """Offsets (2 steps + 1,) along an axis, in its unit, and the scores there (2 steps + 1, 3)."""
        offsets, poses = poses_along(self.T, axis, steps)
        return offsets, np.array([self.at(pose) for pose in poses])


def _entropy(shares: np.ndarray) -> float:
    positive = shares[shares > 0.0]
    return float(-(positive * np.log(positive)).sum())


def drives(data: Path, folder: Path, only: str, max_frames: int) -> Iterator[tuple[str, Profiles]]:
    """Load the drives that are drawn."""
    for real in real_drives(data, folder):
        if (name := real.name) in DRIVES and only in name:
            drive = read_drive(real.path)
            drive = drive.model_copy(update={"frames": drive.frames[:max_frames]})
            found = load(drive, CalibrationConfig(cues=("segments",)))
            yield name, Profiles(found, read_transform(drive.path))


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--steps", default=8, show_default=True, help="Poses on either side of the published one.")
@click.option("--only", default="", help="Only drives whose names contain this.")
@click.option("--max-frames", default=70, help="Frames of each drive.")
def main(data: Path, output: Path, steps: int, only: str, max_frames: int) -> None:
    """Draw the profiles, and print where each score is largest along each axis."""
    with TemporaryDirectory() as folder:
        curves = {
            name: [profiles.along(axis, steps) for axis in range(len(AXES))]
            for name, profiles in drives(data.resolve(), Path(folder), only, max_frames)
        }
    rows = [
        (name, score, *(f"{offsets[np.argmax(scores[:, index])]:+.2g}" for offsets, scores in along))
        for name, along in curves.items()
        for index, score in enumerate(SCORES)
    ]
    print(markdown_table(f"| drive | score | {' | '.join(AXES)} |", rows))
    by_score = {
        name: {
            score: [(offsets, scores[:, index]) for offsets, scores in along]
            for index, score in enumerate(SCORES)
        }
        for name, along in curves.items()
    }
    draw_profiles(by_score, output, head=1.0, linewidth=1.4)
    print(f"written to {output}")


if __name__ == "__main__":
    run_script(main)
