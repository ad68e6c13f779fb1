"""Small recordings, and their import."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import NS, START_NS, BagWriter
from click.testing import CliRunner, Result

from semcal_cli.bags.importing import import_bag
from semcal_cli.bags.topics import Request
from semcal_cli.cli import semcal
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.geometry.poses import pose_from_mounting

T_MOUNT = pose_from_mounting([1.0, -2.0, 3.0], [0.3, 0.1, -0.2])
STAMP_S = START_NS / NS
COLORS = (
    np.array([[[200, 100, 50], [30, 60, 90]], [[10, 20, 250], [240, 230, 5]]], np.uint8)
    .repeat(8, 0)
    .repeat(8, 1)
)
"""Four patches of blue, green, red."""


class Small:
    """A small recording: `count` sweeps and pictures, a tenth of a second apart; functions change its messages."""

    def __init__(self, folder: Path, kind: str = "sqlite3", count: int = 6) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.bag = BagWriter(folder, kind)
        self.count = count
        camera = {
            "model": "plumb_bob",
            "width": 16,
            "height": 16,
            "K": ((9.0, 0.0, 8.0), (0.0, 9.0, 8.0), (0.0, 0.0, 1.0)),
        }
        self.camera = Drive.model_validate(
            {"semcal_drive": 1, "camera": camera, "frames": [{"points": "p.bin"}]}
        ).camera
        self.records = np.ones(20, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("time", "<f4")])
        self.records["x"] = np.arange(20)
        self.records["time"] = np.linspace(0.0, 0.09, 20)

    def write(self, **changes: Any) -> Path:
        """Write the recording; a change is a function of the writer, the index and the stamp that gives a message."""
        make = {
            "info": lambda bag, index, stamp: bag.camera_info(self.camera, stamp),
            "image": lambda bag, index, stamp: bag.image(np.roll(COLORS, index, 0), "bgr8", stamp),
            "points": lambda bag, index, stamp: bag.cloud(self.records, stamp),
        } | changes
        names = {"info": "/cam/camera_info", "image": "/cam/image_raw", "points": "/points"}
        with self.bag as bag:
            for index in range(self.count):
                stamp = START_NS + index * NS // 10
                for key, function in make.items():
                    message = function(bag, index, stamp)
                    if message is not None:
                        bag.write(names.get(key, f"/{key}"), message, stamp + NS // 100)
        return self.bag.path


def run_cli(*arguments: object, code: int | None = 0) -> Result:
    """Run the command; None allows the exit codes of verdicts."""
    result = CliRunner().invoke(semcal, list(map(str, arguments)))
    assert result.exit_code in ((0, 3) if code is None else (code,)), result.output
    return result


def imported(path: Path, out: Path, **settings: Any) -> Any:
    """Import a recording, and return the content of the drive.yaml."""
    import_bag(Request([path], **settings), out)
    return yaml.safe_load((out / "drive.yaml").read_text())


def refused(path: Path, out: Path, **settings: Any) -> str:
    """Import what has to be refused, and return the message."""
    with pytest.raises(InputError) as error:
        import_bag(Request([path], **settings), out)
    assert not (out / "drive.yaml").exists()
    return str(error.value)
