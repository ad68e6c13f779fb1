"""Small recordings, and their import."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import NS, START_NS, BagWriter
from click.testing import Result
from commands import invoke
from moving_street import MovingStreet

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import pose_from_mounting
from semcal_cli.importing.bags.bag_import import ImportedDrive, import_bag
from semcal_cli.importing.bags.topics import BagRequest

Maker = Callable[[BagWriter, int, int], Any]
"""Makes a message of a writer, the index of a moment and its stamp; or none."""
T_MOUNT = pose_from_mounting([1.0, -2.0, 3.0], [0.3, 0.1, -0.2])
STAMP_S = START_NS / NS
COLORS = np.kron(
    np.array([[[200, 100, 50], [30, 60, 90]], [[10, 20, 250], [240, 230, 5]]], np.uint8),
    np.ones((8, 8, 1), np.uint8),
)
"""Four patches of blue, green, red."""
CAMERA = Camera(model="plumb_bob", width=16, height=16, K=((9.0, 0, 8.0), (0, 9.0, 8.0), (0, 0, 1.0)))
RECORDS = np.ones(20, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("time", "<f4")])
RECORDS["x"], RECORDS["time"] = np.arange(20), np.linspace(0.0, 0.09, 20)


def nothing(bag: BagWriter, index: int, stamp: int) -> None:
    """Make no message."""


def info(**changes: Any) -> Maker:
    return lambda bag, index, stamp: bag.camera_info(CAMERA, stamp, **changes)


def image(encoding: str = "bgr8", **changes: Any) -> Maker:
    """Make images that move."""
    return lambda bag, index, stamp: bag.image(np.roll(COLORS, index, 0), encoding, stamp, **changes)


def cloud(records: np.ndarray = RECORDS, **changes: Any) -> Maker:
    return lambda bag, index, stamp: bag.cloud(records, stamp, **changes)


def at(maker: Maker, shift_ns: Callable[[int], int]) -> Maker:
    """Make messages whose stamps are shifted, by their index."""
    return lambda bag, index, stamp: maker(bag, index, stamp + shift_ns(index))


def fill(bag: BagWriter, count: int = 6, **changes: Maker) -> Path:
    """Write `count` cameras, images and sweeps, a tenth of a second apart; changes are by topic, or make others."""
    makers = {"cam/camera_info": info(), "cam/image_raw": image(), "points": cloud()}
    names = {"info": "cam/camera_info", "image": "cam/image_raw"}
    makers |= {names.get(key, key): maker for key, maker in changes.items()}
    with bag:
        for index in range(count):
            stamp = START_NS + index * NS // 10
            for name, maker in makers.items():
                message = maker(bag, index, stamp)
                if message is not None:
                    bag.write(f"/{name}", message, stamp + NS // 100)
    return bag.path


def small(folder: Path, kind: str = "sqlite3", count: int = 6, **changes: Maker) -> Path:
    """Write a small recording, see `fill`."""
    folder.mkdir(parents=True, exist_ok=True)
    return fill(BagWriter(folder, kind), count, **changes)


def recorded(folder: Path, street: MovingStreet, count: int = 12, **makers: Any) -> Path:
    """Record the first sweeps of a street, with small images."""

    def sweep(bag: BagWriter, index: int, stamp: int) -> Any:
        return bag.cloud(street.sweep(index).records(), stamp)

    return small(folder, "mcap library", count, points=sweep, **makers)


def run_cli(*arguments: object, code: int | None = 0) -> Result:
    """Run the command; None allows the exit codes of verdicts."""
    result = invoke(*arguments)
    assert result.exit_code in ((0, 3) if code is None else (code,)), result.output
    return result


def done(path: Path, out: Path, **settings: Any) -> ImportedDrive:
    """Import a recording."""
    return import_bag(BagRequest([path], **settings), out)


def imported(path: Path, out: Path, **settings: Any) -> Any:
    """Import a recording, and return the content of the drive.yaml."""
    return yaml.safe_load(done(path, out, **settings).written.path.read_text())


def remarks(path: Path, out: Path, **settings: Any) -> str:
    """Import a recording, and return the remarks, one on each line."""
    return "\n".join(done(path, out, **settings).written.remarks)


def refused(path: Path, out: Path, **settings: Any) -> str:
    """Import what has to be refused, and return the message; a new folder is not left behind empty."""
    was_there = out.exists()
    with pytest.raises(InputError) as error:
        done(path, out, **settings)
    assert was_there or not out.exists()
    return str(error.value)


def fixed(edges: dict[tuple[str, str], Pose]) -> Maker:
    return lambda bag, index, stamp: bag.transforms(edges) if index == 0 else None


MAST, BODY = pose_from_mounting([5, 6, 7], [1, 2, 3]), pose_from_mounting([-3, 2, 9], [2, 0, 1])
CHAIN = fixed(
    {("base", "mast"): MAST, ("mast", "lidar"): T_MOUNT, ("base", "body"): BODY, ("body", "optical"): T_MOUNT}
)
FAR = pose_from_mounting([0, 0, 0], [500.0, 0, 0])


def moved(stamp: int) -> Pose:
    """Pose of the base in the world: 10 m/s, and a turn."""
    seconds = (stamp - START_NS) / NS
    return pose_from_mounting([0, 0, 20 * seconds], [10 * seconds, 0, 0])


def moving(parent: str, child: str) -> Maker:
    return lambda bag, index, stamp: bag.transforms({(parent, child): moved(stamp)}, stamp)


def odometry(child: str, pose: Callable[[int], Pose] = moved) -> Maker:
    return lambda bag, index, stamp: bag.odometry(pose(stamp), stamp, child)
