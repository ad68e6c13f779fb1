"""Drives that are wrong in one way each, and the line that says so."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

Edit = Callable[[dict[str, Any], Path], object]
"""Breaks a drive: its document, or files in its folder."""


def break_drive(drive: Path, edit: Edit) -> None:
    """Break a drive of at least four frames with images of 640 x 360."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    edit(document, drive)
    (drive / "drive.yaml").write_text(yaml.safe_dump(document))


def cut(path: Path, num_bytes: int) -> None:
    path.write_bytes(path.read_bytes()[:-num_bytes])


def write_png(path: Path, width: int, height: int, channels: int) -> None:
    cv2.imwrite(str(path), np.zeros((height, width, channels), np.uint8))


HOSTILE: dict[str, tuple[Edit, str]] = {
    "missing file": (lambda d, p: (p / "points/000002.bin").unlink(), "points/000002.bin: no such file"),
    "wrong byte count": (
        lambda d, p: cut(p / "points/000001.bin", 3),
        r"points/000001.bin: \d+ bytes is not a multiple of 16",
    ),
    "labels that differ from points": (
        lambda d, p: cut(p / "point_labels/000001.label", 4),
        r"point_labels/000001.label: \d+ labels for the \d+ points of .*points/000001.bin",
    ),
    "label image of another size": (
        lambda d, p: write_png(p / "image_labels/000003.png", 64, 48, 1),
        "image_labels/000003.png: is 64 x 48, the camera is 640 x 360",
    ),
    "label image with three channels": (
        lambda d, p: write_png(p / "image_labels/000003.png", 640, 360, 3),
        r"image_labels/000003.png: has 3 channels, needs one of class ids, or a palette: of colours in the drive",
    ),
    "K that is not 3 x 3": (lambda d, p: d["camera"].update(K=[[1, 2], [3, 4]]), r"drive.yaml: camera.K.*"),
    "K with NaN": (
        lambda d, p: d["camera"]["K"][0].__setitem__(0, float("nan")),
        r"drive.yaml: camera.K\[0\]\[0\].*",
    ),
    "wrong distortion count": (
        lambda d, p: d["camera"].update(distortion=[0.1, 0.2, 0.3]),
        r"drive.yaml: camera.distortion: found 3 coefficients, needed 0 or 4 or 5 for plumb_bob",
    ),
    "no frames": (lambda d, p: d.update(frames=[]), r"drive.yaml: frames.*"),
    "frame without labels": (
        lambda d, p: d["frames"][1].pop("image_labels"),
        r"drive.yaml: frames\[points/000001.bin\].image_labels: found nothing, expected a file of class ids",
    ),
    "one class only": (
        lambda d, p: d.update(classes={"points": {"all": list(range(1, 256))}}),
        "drive.yaml: points: found one class only, 'all', needed at least 2 for mutual information",
    ),
    "a folder for a file": (
        lambda d, p: d["frames"][0].update(points="points/a.bin") or (p / "points/a.bin").mkdir(),
        "points/a.bin: is a folder, needs a file",
    ),
    "a pipe for a file": (
        lambda d, p: d["frames"][0].update(points="points/a.bin") or os.mkfifo(p / "points/a.bin"),
        "points/a.bin: is a special file, needs a file",
    ),
    "a line break in a name": (
        lambda d, p: d["frames"][0].update(points="points/a\nb.bin"),
        "points/a b.bin: no such file",
    ),
    "unknown key": (
        lambda d, p: d.update(camra={}),
        r"drive.yaml: unknown key 'camra'; the nearest known key is 'camera'",
    ),
    "every label ignored": (
        lambda d, p: d.update(classes=None, ignore={"points": [], "image": list(range(256))}),
        r"drive.yaml: image: every label is ignored or not listed under classes",
    ),
}
