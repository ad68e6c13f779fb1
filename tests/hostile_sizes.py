"""Hostile sizes: files that are or claim to be too large, and files whose opening would never end.

Large files are sparse, and pictures of many pixels are written line by line: no case fills a disk or the memory.
"""

import json
import math
import os
import re
import struct
import zlib
from collections.abc import Callable
from functools import cache, partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import yaml
from hostile_commands import Hostile

HUGE = 3 << 30
"""Size of a sparse file that no file of a drive may have."""
NPY = b"\x93NUMPY\x01\x00"
Edit = Callable[[dict[str, Any], Path], object]
"""Changes a drive: its document, or files in its folder."""


def edited(edit: Edit) -> Callable[[Path], None]:
    """A maker of files that changes the drive."""

    def make(folder: Path) -> None:
        path = folder / "drive" / "drive.yaml"
        document = yaml.safe_load(path.read_text())
        edit(document, path.parent)
        path.write_text(json.dumps(document))  # is YAML as well, without anchors

    return make


def named(
    key: str, name: str, content: bytes | Callable[[], bytes] = b"", size: int = 0
) -> Callable[[Path], None]:
    """A maker of a sparse file that a frame of the drive names."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["frames"][0][key] = name
        sparse(drive / name, content if isinstance(content, bytes) else content(), size)

    return edited(edit)


def sparse(path: Path, content: bytes = b"", size: int = 0) -> None:
    """Write a file that goes on with zeros, which take no room on the disk."""
    path.write_bytes(content)
    os.truncate(path, max(size, len(content)))


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


@cache
def png(width: int, height: int, num_lines: int | None = None) -> bytes:
    """A grey PNG of zeros, or the first lines of it: 400 KB hold 400 million pixels."""
    pack, line = zlib.compressobj(9), bytes(width + 1)
    lines = (pack.compress(line) for _ in range(height if num_lines is None else num_lines))
    packed = b"".join([*lines, pack.flush()])
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", packed), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def jpeg(width: int, height: int) -> bytes:
    """The start of a JPEG, with a preview of another size before its own."""
    preview = b"\xff\xd8" + b"\xff\xc0" + struct.pack(">HBHHB", 11, 8, 1, 1, 1) + bytes(3)
    size = struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\1\x11\0"
    return (
        b"\xff\xd8\xff\xe1" + struct.pack(">H", 2 + len(preview)) + preview + b"\xff\xc0" + size + b"\xff\xd9"
    )


def bmp(width: int, height: int) -> bytes:
    return b"BM" + bytes(8) + struct.pack("<IIiiHH", 54, 40, width, -height, 1, 24) + bytes(24)


def npy(dtype: str, *shape: int) -> bytes:
    """The header of an array."""
    header = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return NPY + struct.pack("<H", len(header)) + header


def pcd(num_points: int, encoding: str, data: bytes = b"") -> bytes:
    lines = ["VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {num_points}", "HEIGHT 1", f"POINTS {num_points}", f"DATA {encoding}", ""]
    return "\n".join(lines).encode() + data


def ply(num_points: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {num_points}"]
    return "\n".join([*lines, *(f"property float {axis}" for axis in "xyz"), "end_header", ""]).encode()


def las(num_points: int) -> bytes:
    header = struct.pack("<4s20xBB68xHIIBHI", b"LASF", 1, 2, 227, 227, 0, 0, 20, num_points)
    return header + bytes(227 - len(header))


def bomb(name: str, content: bytes, num_zeros: int) -> bytes:
    """A ZIP of one member that inflates to its content and then zeros, a thousand times its size."""
    pack, zeros = zlib.compressobj(9, zlib.DEFLATED, -15), bytes(1 << 20)
    packed = [pack.compress(content), *(pack.compress(zeros) for _ in range(num_zeros >> 20)), pack.flush()]
    data, crc = b"".join(packed), zlib.crc32(content)
    for _ in range(num_zeros >> 20):
        crc = zlib.crc32(zeros, crc)
    sizes = struct.pack("<HHHIII", 8, 0, 0, crc, len(data), len(content) + (num_zeros >> 20 << 20))
    local = b"PK\3\4" + struct.pack("<HH", 20, 0) + sizes + struct.pack("<HH", len(name), 0) + name.encode()
    entry = b"PK\1\2" + struct.pack("<HHH", 20, 20, 0) + sizes
    entry += struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0) + name.encode()
    end = struct.pack("<HHHHIIH", 0, 0, 1, 1, len(entry), len(local) + len(data), 0)
    return local + data + entry + b"PK\5\6" + end


def lzf_bomb(folder: Path) -> None:
    """A PCD of 45 MB that claims to unpack to 3.9 GB."""
    sizes = struct.pack("<II", 45_000_000, 3_900_000_000)
    named("points", "a.pcd", pcd(325_000_000, "binary_compressed", sizes), 45_000_500)(folder)


def of_pixels(width: int, height: int) -> Callable[[Path], None]:
    """A maker of a drive whose camera has as many pixels as its label image."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["camera"] |= {"width": width, "height": height}
        document["frames"][0]["image_labels"] = "bomb.png"
        (drive / "bomb.png").write_bytes(png(width, height, num_lines=100))

    return edited(edit)


def text(
    name: str, unit: str, count: int, *, before: str = "", after: str = ""
) -> Callable[[Path], object]:
    """A maker of a document of many equal parts."""
    return lambda folder: (folder / name).write_text(before + unit * count + after)


def many_sweeps(last: int, num_frames: int = 40) -> Callable[[Path], None]:
    """A maker of a drive with as many sweeps of ten million points, all at zero, and the size of the last one."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        frame = document["frames"][0]
        document["frames"] = [frame | {"points": f"{index}.bin"} for index in range(num_frames)]
        for index in range(num_frames):
            sparse(drive / f"{index}.bin", size=160_000_000 if index < num_frames - 1 else last)

    return edited(edit)


def repeated(folder: Path, num_frames: int = 2000) -> None:
    """A calibration of a drive, which then names its frame many times, also by other names of its files."""
    drive = folder / "drive"
    frame = yaml.safe_load((drive / "drive.yaml").read_text())["frames"][0]
    frames = list(islice(cycle([frame, frame | {"points": "./" + frame["points"]}]), num_frames))
    write_calibration(folder)
    calibration = yaml.safe_load((folder / "c.yaml").read_text())
    calibration["input"]["frames"] = [
        {key: each[key] for key in ("points", "point_labels", "image_labels")} for each in frames
    ]
    (folder / "c.yaml").write_text(json.dumps(calibration))
    edited(lambda document, _: document.update(frames=frames))(folder)


def write_calibration(folder: Path) -> None:
    """Write the calibration of the drive, c.yaml."""
    from click.testing import CliRunner

    from semcal_cli.cli import semcal

    CliRunner().invoke(semcal, ["initialize", str(folder / "drive"), "-o", str(folder / "c.yaml"), "-q"])


def pipe(key: str, name: str) -> Callable[[Path], None]:
    """A maker of a pipe that a frame of the drive names."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["frames"][0][key] = name
        os.mkfifo(drive / name)

    return edited(edit)


def with_features(document: dict[str, Any], drive: Path) -> None:
    """Give the frame features, all zero."""
    for side, *shape in (("point_features", 12_027, 2), ("image_features", 180, 320, 2)):
        document["frames"][0][side] = f"{side}.npy"
        header = npy("<f4", *shape)
        sparse(drive / f"{side}.npy", header, len(header) + 4 * math.prod(shape))


def with_poses(document: dict[str, Any], drive: Path) -> None:
    document["motion"] = {"poses": "poses.txt"}


def all_of(*makers: Callable[[Path], object]) -> Callable[[Path], None]:
    """A maker that does one thing after the other."""

    def make(folder: Path) -> None:
        for each in makers:
            each(folder)

    return make


def zeros(name: str, content: bytes = b"", size: int = HUGE) -> Callable[[Path], None]:
    """A maker of a sparse file."""
    return lambda folder: sparse(folder / name, content, size)


def instead(name: str) -> Callable[[Path], None]:
    """A maker of a pipe that takes a file's place."""
    return all_of(lambda folder: (folder / name).unlink(), lambda folder: os.mkfifo(folder / name))


def error(text: str) -> str:
    """The pattern of a line that is this error about a file of the drive."""
    return f"^semcal: error: {re.escape(text)}$"


CALIBRATE = ("calibrate", "drive", "-q")
INTENSITY = (*CALIBRATE, "--cue", "intensity")
FEATURES = (*CALIBRATE, "--cue", "features", "--estimator", "mine")
TOO_LARGE = "found 3,221,225,472 bytes, needed at most"
OF_SWEEP = f"{TOO_LARGE} 640,000,000, 64 a point: see --max-points"
NO_FILE = "is no regular file, needs a file"

SWEEPS = {
    f"a sparse {name}": Hostile(
        named("points", name, content, HUGE), CALIBRATE, error(f"drive/{name}: {OF_SWEEP}")
    )
    for name, content in {
        "a.bin": b"",
        "a.pcd.bin": b"",
        "a.pcd": pcd(200_000_000, "binary"),
        "a.ply": ply(200_000_000),
        "a.npy": npy("<f4", 200_000_000, 4),
        "a.npz": b"PK\3\4",
        "a.las": las(150_000_000),
        "a.laz": las(150_000_000),
    }.items()
}
COUNTS = {
    f"too many points of {name}": Hostile(
        named("points", name, content, size),
        CALIBRATE,
        error(f"drive/{name}: found {count} points, needed at most 10,000,000: see --max-points"),
    )
    for name, content, size, count in (
        ("a.bin", b"", 320_000_000, "20,000,000"),
        ("a.pcd", pcd(40_000_000, "binary"), 480_000_300, "40,000,000"),
        ("a.ply", ply(40_000_000), 480_000_300, "40,000,000"),
        ("a.las", las(30_000_000), 600_000_227, "30,000,000"),
    )
}
LABELS = {
    f"sparse labels {name}": Hostile(
        named("point_labels", name, content, HUGE), CALIBRATE, error(f"drive/{name}: {OF_SWEEP}")
    )
    for name, content in {
        "a.label": b"",
        "a.npy": npy("<i8", 400_000_000),
        "a.npz": b"PK\3\4",
    }.items()
}
LABEL_IMAGES = {
    f"a sparse label image {name}": Hostile(
        named("image_labels", name, content, HUGE),
        CALIBRATE,
        f"^semcal: error: drive/{name}: {TOO_LARGE} .*57.?600",
    )
    for name, content in {
        "a.png": png(320, 180),
        "a.npy": npy("<i8", 180, 320),
        "a.npz": b"PK\3\4",
    }.items()
}
PICTURES = {
    f"a picture {name} of 20,000 squared pixels": Hostile(
        named("image", name, content, size),
        INTENSITY,
        error(f"drive/{name}: found 20000 x 20000 pixels, needed 320 x 180"),
    )
    for name, content, size in (
        ("a.jpg", jpeg(20_000, 20_000), 0),
        ("a.bmp", bmp(20_000, 20_000), 1_200_000_054),
    )
}
DOCUMENTS = {
    "a sparse drive.yaml": Hostile(
        zeros("drive/drive.yaml"),
        ("inspect", "drive"),
        error(f"drive/drive.yaml: {TOO_LARGE} 16,777,216"),
    ),
    "a sparse rig": Hostile(
        zeros("rig.yaml", b"semcal_rig: 1\n"),
        ("calibrate", "rig.yaml", "-o", "out"),
        error(f"rig.yaml: {TOO_LARGE} 16,777,216"),
    ),
    "a list of drives of 2 GB": Hostile(
        zeros("list.txt", b"drive\n", 2 << 30),
        ("batch", "list.txt", "-o", "out"),
        error("list.txt: found 2,147,483,648 bytes, needed at most 16,777,216"),
    ),
    "a sparse calibration": Hostile(
        zeros("c.yaml", b"semcal_calibration: 1\n"),
        ("verify", "drive", "c.yaml"),
        error(f"c.yaml: {TOO_LARGE} 16,777,216"),
    ),
    "a drive.yaml of twelve million tiny values": Hostile(
        text("drive/drive.yaml", "- a\n- []\n", 1_500_000),
        ("inspect", "drive"),
        r"^semcal: error: drive/drive.yaml: found a list of 3000000, needed a mapping$",
    ),
    "a drive.yaml of empty lists": Hostile(
        text("drive/drive.yaml", "[],", 4_000_000, before="[", after="]"),
        ("inspect", "drive"),
        error("drive/drive.yaml: found more than 8,000,000 values, needed fewer"),
    ),
    "a drive of wrong frames": Hostile(
        text("drive.json", "{},", 5_000_000, before='{"semcal_drive": 1, "frames": [', after="{}]}"),
        ("inspect", "drive.json"),
        r"^semcal: error: drive.json: camera: found nothing, needed a value$",
    ),
    "a rig of blank lines": Hostile(
        text("rig.yaml", "\n", 8_000_000, after="semcal_rig"),
        ("calibrate", "rig.yaml", "-o", "out"),
        error("rig.yaml: found 'semcal_rig', needed a mapping"),
    ),
    "a camera file of blank lines": Hostile(
        text("T.yml", "\n", 900_000, before="%YAML:1.0\n", after="CameraExtrinsicMat: 1\n"),
        ("convert", "T.yml", "--from", "opencv", "--direction", "lidar-to-camera", "--to", "kitti-odometry"),
        r"^semcal: error: T.yml: CameraExtrinsicMat: found 1 numbers, needed 16 by rows, or 12$",
    ),
    "a drive of a million names of classes": Hostile(
        lambda folder: (folder / "drive.json").write_text(
            json.dumps(
                {"semcal_drive": 1, "classes": {"points": {str(name): 0 for name in range(1_000_000)}}}
            )
        ),
        ("inspect", "drive.json"),
        error("drive.json: classes: found a mapping of 1,000,001 entries, needed at most 500,000"),
    ),
    "poses of 3 GB": Hostile(
        all_of(edited(with_poses), zeros("drive/poses.txt")),
        CALIBRATE,
        error(f"drive/poses.txt: {TOO_LARGE} 67,108,864"),
    ),
}
PIPES = {
    "a pipe for a drive": Hostile(
        instead("drive/drive.yaml"),
        ("inspect", "drive"),
        error("drive/drive.yaml: found no regular file, needed a file"),
    ),
    "a pipe for poses": Hostile(
        all_of(edited(with_poses), lambda folder: os.mkfifo(folder / "drive" / "poses.txt")),
        CALIBRATE,
        error("drive/poses.txt: found no regular file, needed a file"),
    ),
    f"a pipe for {key} {name}": Hostile(pipe(key, name), command, error(f"drive/{name}: {line}"))
    for key, name, command, line in (
        ("points", "a.las", CALIBRATE, "found no regular file, needed a file"),
        ("points", "a.pcd", CALIBRATE, NO_FILE),
        ("points", "a.npz", CALIBRATE, NO_FILE),
        ("point_labels", "a.npz", CALIBRATE, NO_FILE),
        ("image_labels", "a.png", CALIBRATE, NO_FILE),
        ("image", "a.png", INTENSITY, "found no regular file, needed a file"),
    )
}

SIZES: dict[str, Hostile] = {
    **SWEEPS,
    **COUNTS,
    **LABELS,
    **LABEL_IMAGES,
    **PICTURES,
    **DOCUMENTS,
    **PIPES,
    "a label image of 65,535 squared pixels": Hostile(
        of_pixels(65_535, 65_535),
        CALIBRATE,
        error("drive/drive.yaml: camera.height: found 65,535 x 65,535 pixels, needed at most 100,000,000"),
    ),
    "a label image of 20,000 squared pixels": Hostile(
        named("image_labels", "a.png", partial(png, 20_000, 20_000)),
        CALIBRATE,
        error("drive/a.png: is 20000 x 20000, the camera is 320 x 180"),
    ),
    "a picture of 20,000 squared pixels": Hostile(
        named("image", "a.png", partial(png, 20_000, 20_000)),
        INTENSITY,
        error("drive/a.png: found 20000 x 20000 pixels, needed 320 x 180"),
    ),
    "compressed points that claim 3.9 GB": Hostile(
        lzf_bomb,
        CALIBRATE,
        error("drive/a.pcd: found 325,000,000 points, needed at most 10,000,000: see --max-points"),
    ),
    "an archive of points that inflates to 256 MB": Hostile(
        named("points", "a.npz", partial(bomb, "points.npy", npy("<f4", 16_777_216, 4), 256 << 20)),
        CALIBRATE,
        r"^semcal: error: drive/a.npz: array points found 268,435,\d+ bytes, needed at most 2\d,\d+,\d+$",
    ),
    "a sweep beside many others": Hostile(many_sweeps(HUGE), CALIBRATE, error(f"drive/39.bin: {OF_SWEEP}")),
    "many sweeps of zeros": Hostile(
        many_sweeps(160_000_000),
        CALIBRATE,
        error("drive/0.bin: holds no returns: every point is zero or not finite"),
    ),
    "sparse features": Hostile(
        all_of(edited(with_features), zeros("drive/point_features.npy")),
        FEATURES,
        error(f"drive/point_features.npy: {OF_SWEEP}"),
    ),
    "features behind a pipe": Hostile(
        all_of(edited(with_features), instead("drive/image_features.npy")),
        FEATURES,
        error("drive/image_features.npy: found no regular file, needed a file"),
    ),
    "a calibration of a drive that repeats its frame": Hostile(
        repeated, ("report", "drive", "c.yaml", "-o", "page.html"), r"^page\.html$|^$", exit_code=0
    ),
}
