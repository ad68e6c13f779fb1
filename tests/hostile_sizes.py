"""Hostile sizes: files that are or claim to be too large, and files whose opening would never end."""

import json
import re
from functools import partial

from hostile_commands import Hostile
from hostile_files import (
    HUGE,
    all_of,
    bmp,
    bomb,
    edited,
    instead,
    las,
    lzf_bomb,
    many_sweeps,
    named,
    npy,
    of_pixels,
    pcd,
    pipe_of_frame,
    png,
    repeated,
    text,
    with_features,
    with_poses,
    zeros,
)


def error(text: str) -> str:
    """The pattern of a line that is this error about a file of the drive."""
    return f"^semcal: error: {re.escape(text)}$"


CALIBRATE = ("calibrate", "drive", "-q")
INTENSITY = (*CALIBRATE, "--cue", "intensity")
FEATURES = (*CALIBRATE, "--cue", "features", "--estimator", "mine")
TOO_LARGE = "found 3,221,225,472 bytes, needed at most"
OF_SWEEP = f"{TOO_LARGE} 640,000,000, 64 a point: see --max-points"
NO_FILE = "is a special file, needs a file"

OF_PIXELS = "1,970,176 for 320 x 180 pixels"


def too_many(count: str) -> str:
    return f"found {count} points, needed at most 10,000,000: see --max-points"


FILES = (
    ("points", "a.bin", b"", HUGE, OF_SWEEP),
    ("points", "a.pcd", pcd(200_000_000, "binary"), HUGE, OF_SWEEP),
    ("points", "a.las", las(150_000_000), HUGE, OF_SWEEP),
    ("points", "a.e57", b"ASTM-E57", HUGE, OF_SWEEP),
    ("points", "a.bin", b"", 320_000_000, too_many("20,000,000")),
    ("points", "a.las", las(30_000_000), 600_000_227, too_many("30,000,000")),
    ("point_labels", "a.label", b"", HUGE, OF_SWEEP),
    ("image_labels", "a.png", png(320, 180), HUGE, f"{TOO_LARGE} {OF_PIXELS}"),
    ("image_labels", "a.npz", b"PK\3\4", HUGE, f"{TOO_LARGE} 117,544,000 for 57600 items"),
    ("image", "a.bmp", bmp(20_000, 20_000), 1_200_000_054, "found 20000 x 20000 pixels, needed 320 x 180"),
)
"""Sparse files of a frame: their key, their name, how they begin, their size, and what is said of them."""
OF_FILES = {
    f"a file {name} of {size:,} bytes for {key}": Hostile(
        named(key, name, content, size),
        INTENSITY if key == "image" else CALIBRATE,
        error(f"drive/{name}: {complaint}"),
    )
    for key, name, content, size, complaint in FILES
}
DOCUMENTS = {
    "a sparse drive.yaml": Hostile(
        zeros("drive/drive.yaml"),
        ("inspect", "drive"),
        error(f"drive/drive.yaml: {TOO_LARGE} 16,777,216"),
    ),
    "a list of drives of 2 GB": Hostile(
        zeros("list.txt", b"drive\n", 2 << 30),
        ("batch", "list.txt", "-o", "out"),
        error("list.txt: found more than 16 MiB, expected a list of drives"),
    ),
    "a drive.yaml of twelve million tiny values": Hostile(
        text("drive/drive.yaml", "- a\n- []\n", 1_500_000),
        ("inspect", "drive"),
        r"^semcal: error: drive/drive.yaml: found a list of 3000000, expected a mapping$",
    ),
    "a drive.yaml of empty lists": Hostile(
        text("drive/drive.yaml", "[],", 4_000_000, before="[", after="]"),
        ("inspect", "drive"),
        error("drive/drive.yaml: found more than 8,000,000 values, needed fewer"),
    ),
    "a drive of wrong frames": Hostile(
        text("drive.json", "{},", 5_000_000, before='{"semcal_drive": 1, "frames": [', after="{}]}"),
        ("inspect", "drive.json"),
        r"^semcal: error: drive.json: camera: found nothing, expected a value$",
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
OF_FRAMES = {
    f"a pipe for {key} {name}": Hostile(pipe_of_frame(key, name), command, error(f"drive/{name}: {line}"))
    for key, name, command, line in (
        ("points", "a.las", CALIBRATE, "found a special file, expected a file"),
        ("points", "a.e57", CALIBRATE, "found a special file, expected a file"),
        ("points", "a.pcd", CALIBRATE, NO_FILE),
        ("image_labels", "a.png", CALIBRATE, NO_FILE),
        ("image", "a.png", INTENSITY, "found a special file, expected a file"),
    )
}
PIPES = {
    "a pipe for a drive": Hostile(
        instead("drive/drive.yaml"),
        ("inspect", "drive"),
        error("drive/drive.yaml: found a special file, expected a file"),
    ),
    **OF_FRAMES,
}

SIZES: dict[str, Hostile] = {
    **OF_FILES,
    **DOCUMENTS,
    **PIPES,
    "a label image of 65,535 squared pixels": Hostile(
        of_pixels(65_535, 65_535),
        CALIBRATE,
        error("drive/drive.yaml: camera.height: found 65,535 x 65,535 pixels, needed at most 100,000,000"),
    ),
    "a label image of 20,000 squared pixels": Hostile(
        named("image_labels", "a.png", partial(png, 20_000, 20_000, num_lines=100)),
        CALIBRATE,
        error("drive/a.png: is 20000 x 20000, the camera is 320 x 180"),
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
    "sparse features": Hostile(
        all_of(edited(with_features), zeros("drive/point_features.npy")),
        FEATURES,
        error(f"drive/point_features.npy: {OF_SWEEP}"),
    ),
    "a calibration of a drive that repeats its frame": Hostile(
        repeated, ("report", "drive", "c.yaml", "-o", "page.html"), r"^page\.html$|^$", exit_code=0
    ),
}
