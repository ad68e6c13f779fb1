"""Prints a Markdown table, and draws, how the time of a calibration grows with frames, points, classes and threads.

    python tests/benchmarks/growth.py --pool DIR -o docs/pictures/growth.png

Whole processes calibrate synthetic drives by labels, from nothing: 20 frames of 48,000 points and 20 classes, or 5
frames where points grow, with images of 640 x 360 pixels. One quantity changes at a time. The exponent is the slope of
the logarithm of the time from one row to the next: 1 where the time doubles with the quantity.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import yaml
from benchmark import SEMCAL, Ended, run_process, script, street, table
from matplotlib.figure import Figure

FRAMES, FRAMES_OF_POINTS, COLUMNS, CLASSES, APART = 20, 5, 800, 20, 30
"""The quantities that do not change; classes of different frames are `APART` ids apart where there are more than 20."""
SECONDS = (0.5, 1.0, 2.0, 4.0)
"""Ticks of the image."""
LABELS = {"point_labels": "label", "image_labels": "png"}
"""Endings of the files of labels."""


def with_classes(drive: Path, folder: Path, count: int) -> Path:
    """Write a drive again with fewer classes, some merged, or with more, those of some frames apart from the others."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    folder.mkdir(exist_ok=True)
    frames = []
    for index, frame in enumerate(document["frames"]):
        # The upper half of a label is the number of an object.
        points = np.fromfile(drive / frame["point_labels"], np.uint32) & 0xFFFF
        image = cv2.imread(str(drive / frame["image_labels"]), cv2.IMREAD_UNCHANGED)
        group = index % max(count // CLASSES, 1)
        to_ids = 1 + (np.arange(256) % count if count < CLASSES else np.arange(256) + APART * group) % 255
        to_ids[0] = 0
        names = {key: str(folder / f"{index}.{ending}") for key, ending in LABELS.items()}
        to_ids[points].astype(np.uint32).tofile(names["point_labels"])
        cv2.imwrite(names["image_labels"], to_ids[image].astype(np.uint8))
        frames.append(frame | names | {key: str(drive / frame[key]) for key in ("points", "image")})
    del document["classes"]
    (folder / "drive.yaml").write_text(yaml.safe_dump(document | {"frames": frames}))
    return folder


def main(
    *,
    pool: Path,
    output: Path,
    frames: tuple[int, ...] = (1, 5, 20, 100, 500),
    points: tuple[int, ...] = (10_000, 30_000, 100_000, 300_000, 1_000_000),
    classes: tuple[int, ...] = (2, 5, 20, 100),
    threads: tuple[int, ...] = (1, 2),
    width: int = 640,
    repeats: int = 3,
) -> Iterator[str]:
    """Time each, and draw the times."""
    pool = pool.absolute()
    pool.mkdir(parents=True, exist_ok=True)

    def drive(num_frames: int, columns: int) -> Path:
        path = pool / f"{num_frames}_{columns}_{width}"
        if not path.exists():
            street(path, 0, num_frames, width, columns=columns)
        return path

    def time(path: Path, num_threads: int | None = None) -> Ended:
        words = ["calibrate", str(path), "-o", str(pool / "found.yaml"), "-q"]
        words += [] if num_threads is None else ["--threads", str(num_threads)]
        ended = sorted(run_process([*SEMCAL, *words]) for _ in range(repeats))
        return ended[len(ended) // 2]

    base = min(FRAMES, max(frames))
    found = {
        "frames": {n: time(drive(n, COLUMNS)) for n in frames},
        "points of a frame": {
            n: time(drive(min(FRAMES_OF_POINTS, base), math.ceil(COLUMNS * n / 48_000))) for n in points
        },
        "classes": {n: time(with_classes(drive(base, COLUMNS), pool / f"{n}_classes", n)) for n in classes},
        "threads": {n: time(drive(base, COLUMNS), n) for n in threads},
    }
    draw(found, output)

    def rows() -> Iterator[tuple[str, ...]]:
        for quantity, by_value in found.items():
            before: tuple[int, Ended] | None = None
            for value, ended in by_value.items():
                exponent = ""
                if before is not None:
                    slope = math.log(ended.seconds / before[1].seconds) / math.log(value / before[0])
                    exponent = f"{slope:.2f}"
                yield (
                    quantity,
                    f"{value:,}",
                    f"{ended.seconds:.2f}",
                    f"{ended.cpu_s:.2f}",
                    exponent,
                )
                before = value, ended

    yield from table("quantity | value | seconds | CPU, s | exponent", rows())
    yield f"written to {output}"


def draw(found: dict[str, dict[int, Ended]], path: Path) -> None:
    """Draw the times of each quantity, with logarithmic axes."""
    figure = Figure(figsize=(11.0, 3.0), layout="constrained")
    for axes, (quantity, by_value) in zip(
        figure.subplots(1, len(found), sharey=True), found.items(), strict=True
    ):
        axes.loglog(list(by_value), [ended.seconds for ended in by_value.values()], "o-")
        axes.set_xlabel(quantity)
        axes.minorticks_off()
        axes.xaxis.set_major_formatter("{x:,.0f}")
        axes.set_yticks(SECONDS, [f"{each:g}" for each in SECONDS])
        axes.grid(visible=True, which="major", color="0.85")
    figure.axes[0].set_ylabel("seconds")
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    script(main)
