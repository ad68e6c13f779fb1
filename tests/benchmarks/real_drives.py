"""Where real drives without labels of points end, as a Markdown table: a row for each drive and cue.

    python tests/benchmarks/real_drives.py ../shared/data

Every run starts 2 degrees and 0.2 m off, in a direction of its own, as `semcal refine` would. The drives: a KITTI jam
of 13 pairs, OpenCalib's three road frames singly and two of one camera together, and the six cameras of a nuScenes
keyframe. The pictures' labels are a network's.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import yaml

from semcal_cli.config import CalibrationConfig, Cue
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.formats import read_transform
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import assess, make_calibration, refine_and_polish, start_at

START_DEG, START_M = 2.0, 0.2
NEAR_DEG, NEAR_CM = 0.5, 10.0
"""Errors within which a run has come back."""
WRONG_DEG = 1.0
"""Error beyond which no run may be trusted."""
CUES: tuple[tuple[Cue, ...], ...] = (("segments",), ("segments", "intensity"), ("intensity",))
CITYSCAPES = [
    *(
        "road",
        "sidewalk",
        "building",
        "wall",
        "fence",
        "pole",
        "light",
        "sign",
        "vegetation",
        "terrain",
        "sky",
    ),
    *("person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
]


def jam(data: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """The drive of KITTI's jam."""
    day = data / "kitti_raw_jam/2011_09_26"
    drive = day / "2011_09_26_drive_0000_sync"
    velo, camera = (dict(_numbers(day / f"calib_{name}.txt")) for name in ("velo_to_cam", "cam_to_cam"))
    T_velo = np.eye(4)
    T_velo[:3] = np.column_stack([velo["R"].reshape(3, 3), velo["T"]])
    rectify, P = np.eye(4), camera["P_rect_02"].reshape(3, 4)
    rectify[:3, :3] = camera["R_rect_00"].reshape(3, 3)
    shift = np.eye(4)
    shift[:3, 3] = np.linalg.solve(P[:, :3], P[:, 3])
    width, height = camera["S_rect_02"].astype(int).tolist()
    frames = [
        {
            "points": str(drive / f"velodyne_points/data/{labels.stem}.bin"),
            "image": str(drive / f"image_02/data/{labels.stem}.png"),
            "image_labels": str(labels),
        }
        for labels in sorted((data / "kitti_raw_jam/image_labels").glob("*.png"))
    ]
    lens = {"model": "plumb_bob", "width": width, "height": height, "K": P[:, :3].tolist()}
    yield "KITTI jam, 13 pairs", _write(folder / "jam", lens, frames, shift @ rectify @ T_velo)


def opencalib(data: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """OpenCalib's road frames; the first two have one camera."""
    lenses, frames, poses = [], [], []
    for number in "123":
        source = data / "opencalib_road" / number
        numbers = dict(_numbers(source / "calib.txt"))
        (image,) = (path for path in source.glob("calib.*") if path.suffix in (".jpg", ".png"))
        lenses.append(
            {
                "model": "plumb_bob",
                "width": 1920,
                "height": 1200,
                "K": numbers["K"].reshape(3, 3).tolist(),
                "distortion": numbers["D"].tolist(),
            }
        )
        labels = data / f"opencalib_road/image_labels/{number}.png"
        frames.append({"points": str(source / "calib.pcd"), "image": str(image), "image_labels": str(labels)})
        poses.append(np.vstack([numbers["T"].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]))
        where = _write(folder / f"opencalib_{number}", lenses[-1], frames[-1:], poses[-1])
        yield f"OpenCalib {number}", where
    yield "OpenCalib 1 and 2", _write(folder / "opencalib_1_2", lenses[0], frames[:2], poses[0])


def nuscenes(data: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """Six cameras of a keyframe of nuScenes."""
    source = data / "nuscenes_keyframe"
    (points,) = source.glob("*.pcd.bin")
    for name, camera in json.loads((source / "calib.json").read_text()).items():
        if name.startswith("CAM_"):
            lens = {"model": "plumb_bob", "width": 1600, "height": 900, "K": camera["K"]}
            labels = source / "image_labels" / f"{Path(camera['img']).stem}.png"
            frame = {"points": str(points), "image": str(source / camera["img"]), "image_labels": str(labels)}
            where = _write(folder / name.lower(), lens, [frame], np.array(camera["lidar2cam"]))
            yield f"nuScenes {name[4:].lower().replace('_', ' ')}", where


def _numbers(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    for line in path.read_text().splitlines():
        key, _, values = line.partition(":")
        if key.strip() != "calib_time":
            yield key.strip(), np.array(values.replace(",", " ").split(), np.float64)


def _write(folder: Path, lens: dict[str, object], frames: Sequence[object], T: np.ndarray) -> Path:
    folder.mkdir()
    names = {name: [index] for index, name in enumerate(CITYSCAPES)}
    document = {"semcal_drive": 1, "camera": lens, "frames": list(frames), "T_camera_lidar": T.tolist()}
    document |= {"classes": {"image": names}}
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    return folder


def run(data: LoadedDrive, T: np.ndarray, seed: int) -> tuple[float, float, str]:
    """One start: errors in degrees and centimetres, and the status."""
    config = CalibrationConfig(cues=data.cues)
    start = InitialPose(displaced(T, START_DEG, START_M, np.random.default_rng(seed)), "start")
    try:
        initial = start_at(data, start)
        stages = assess(data, refine_and_polish(data, initial, config.refinement), config.refinement)
    except SemcalError as failure:
        return np.inf, np.inf, f"failed: {failure}"
    error = compare_poses(stages.T_camera_lidar, T)
    calibration = make_calibration(data, stages, config, initial_pose=start)
    return error.rotation_deg, error.camera_center_cm, calibration.status


def table_row(name: str, cues: Sequence[str], results: Sequence[tuple[float, float, str]]) -> str:
    """Format the runs of a drive by some cues."""
    deg, cm = np.array([each[:2] for each in results]).T
    near = int(((deg <= NEAR_DEG) & (cm <= NEAR_CM)).sum())
    trusted = np.array([each[2] == "trusted" for each in results])
    wrong = int((trusted & (deg > WRONG_DEG)).sum())
    median = f"{np.median(deg):.2f}, {deg.max():.2f} | {np.median(cm):.1f}, {cm.max():.1f}"
    return f"| {name} | {','.join(cues)} | {len(results)} | {median} | {near} | {trusted.sum()} | {wrong} |"


def evaluate(
    drive: Drive, cues: tuple[Cue, ...], starts: int, first_seed: int
) -> list[tuple[float, float, str]]:
    """All starts of a drive by some cues."""
    data, T = load(drive, CalibrationConfig(cues=cues)), read_transform(drive.path)
    return [run(data, T, seed) for seed in range(first_seed, first_seed + starts)]


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("--starts", default=10, show_default=True)
@click.option("--first-seed", default=90, show_default=True)
@click.option("--only", default="", help="Only drives whose names contain this.")
@click.option("--max-frames", default=70, help="Frames of each drive.")
def main(data: Path, starts: int, first_seed: int, only: str, max_frames: int) -> None:
    """Print the table."""
    print("| drive | cue | n | rotation, deg: median, worst | camera centre, cm: median, worst ", end="")
    print(
        f"| within {NEAR_DEG:g} deg, {NEAR_CM:g} cm | trusted | trusted and more than {WRONG_DEG:g} deg off |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        for kind in (jam, opencalib, nuscenes):
            for name, where in kind(data.resolve(), Path(folder)):
                if only in name:
                    drive = read_drive(where)
                    drive = drive.model_copy(update={"frames": drive.frames[:max_frames]})
                    for cues in CUES:
                        row = table_row(name, cues, evaluate(drive, cues, starts, first_seed))
                        print(row, flush=True)


if __name__ == "__main__":
    run_script(main)
