"""Set the synthetic world's figures beside those of real drives, as a Markdown table.

    python tests/benchmarks/world_realism.py --seeds 10 --frames 10 --drive DRIVE

Every figure is that of one frame at the true (for a real drive: the published) transform; the table gives the
median over the frames and, in brackets, the smallest and the largest. Shares of classes are means.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from benchmark import script, table

from semcal_cli import core
from semcal_cli.config.synthetic import SynthConfig, SynthLens
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import (
    NO_CLASS,
    FrameObservation,
    LabelledCloud,
    LabelledImage,
    Observations,
)
from semcal_cli.observations.reading import class_table, load_observations
from semcal_cli.synthetic.frame_files import UNLABELED
from semcal_cli.synthetic.synthesis import make_camera, make_renderer, mounting

HIDDEN, VISIBLE = 1, 2
MIN_POINTS = 50
TOP_CLASSES = 8

Figures = dict[str, float]
"""Figures of one frame, by the row of the table that they belong to."""
HIDDEN_EXACTLY = "- of these hidden from the camera, by ray casting"
ROWS = {
    "classes in view": ".0f",
    "classes in the image": ".0f",
    f"classes with {MIN_POINTS} points in the image": ".0f",
    "objects in view": ".0f",
    "points": ",.0f",
    "points in the image": ",.0f",
    HIDDEN_EXACTLY: ".1%",
    "- of these hidden from the camera, by the z-buffer": ".1%",
    "- of these of the commonest class": ".1%",
    "share of the image that points cover": ".1%",
    "MI, nats, less its bias": ".3f",
    "label agreement": ".1%",
}


def synthetic_frames(lens: SynthLens, num_seeds: int, num_frames: int) -> Iterator[tuple[Figures, Figures]]:
    """Render; each seed has a rig of its own."""
    for seed in range(num_seeds):
        config = SynthConfig(seed=seed, lens=lens)
        T_camera_lidar = mounting(config)
        renderer = make_renderer(config, T_camera_lidar)
        for number in range(num_frames):
            frame = renderer.frame(seed, number)
            observations = _observe(config, frame.points, frame.point_labels, frame.image_labels)
            figures, shares = describe_frame(observations, T_camera_lidar)
            hidden, visible = (
                np.count_nonzero(frame.point_visibility == value) for value in (HIDDEN, VISIBLE)
            )
            figures["objects in view"] = frame.num_objects
            figures[HIDDEN_EXACTLY] = hidden / (hidden + visible)
            yield figures, shares


def real_frames(path: Path) -> Iterator[tuple[Figures, Figures]]:
    """Read a drive with a reference transform."""
    drive = read_drive(path)
    if drive.T_camera_lidar is None:
        raise click.UsageError(f"{drive.path}: T_camera_lidar: found nothing, expected a transform")
    observations = load_observations(drive)
    for number in range(observations.num_frames):
        yield describe_frame(observations.of_frames([number]), np.array(drive.T_camera_lidar))


def describe_frame(frame: Observations, T_camera_lidar: Pose) -> tuple[Figures, Figures]:
    """Give the figures of a frame, and each class's share of the points in the image."""
    agreement = core.agreement(frame.core, T_camera_lidar)
    classes = frame.clouds[0].classes
    points = frame.clouds[0].points
    ranges = core.project_points(core_camera(frame.camera), points, T_camera_lidar).ranges
    inside = classes[np.isfinite(ranges) & (classes != NO_CLASS)]
    counts = np.bincount(inside, minlength=len(frame.point_class_names))
    in_image = _names(frame.image_class_names, frame.images[0].classes)
    in_view = in_image | _names(frame.point_class_names, classes)
    figures = {
        "classes in view": len(in_view),
        "classes in the image": len(in_image),
        f"classes with {MIN_POINTS} points in the image": np.count_nonzero(counts >= MIN_POINTS),
        "points": len(classes),
        "points in the image": agreement.num_inside,
        "- of these hidden from the camera, by the z-buffer": agreement.num_hidden / agreement.num_inside,
        "- of these of the commonest class": counts.max() / counts.sum(),
        "share of the image that points cover": agreement.overlap,
        "MI, nats, less its bias": agreement.mutual_information - agreement.bias,
        "label agreement": agreement.label_agreement,
    }
    shares = dict(zip(frame.point_class_names, (counts / counts.sum()).tolist(), strict=True))
    return figures, shares


def _observe(
    config: SynthConfig,
    points: npt.NDArray[np.float32],
    labels: npt.NDArray[np.uint32],
    image_labels: npt.NDArray[np.uint8],
) -> Observations:
    named = {name: (id_,) for id_, name in core.synthetic_classes()}
    point_ids, image_ids = (labels & 0xFFFF).astype(np.uint16), image_labels.astype(np.uint16)
    point_table = class_table([point_ids], named, [UNLABELED])
    image_table = class_table([image_ids], named, [UNLABELED])
    cloud = LabelledCloud(np.ascontiguousarray(points[:, :3]), *point_table(point_ids))
    return Observations(
        camera=make_camera(config),
        lidar=None,
        frame_observations=(FrameObservation(cloud, LabelledImage(*image_table(image_ids))),),
        point_class_names=point_table.names,
        image_class_names=image_table.names,
    )


def _names(names: Sequence[str], classes: npt.NDArray[np.uint8]) -> set[str]:
    return {names[i] for i in np.unique(classes) if i != NO_CLASS}


def rows(columns: Sequence[Sequence[tuple[Figures, Figures]]]) -> Iterator[tuple[str, ...]]:
    """Medians and ranges, and the commonest classes last."""
    for row, style in ROWS.items():
        listed = ([figures[row] for figures, _ in column if row in figures] for column in columns)
        yield row, *(_cell(values, style) for values in listed)
    commonest = (_commonest([shares for _, shares in column]) for column in columns)
    yield "points in the image, by class", *commonest


def _cell(values: list[float], style: str) -> str:
    if not values:
        return "not known"
    middle, low, high = (format(float(f(values)) + 0.0, style) for f in (np.median, np.min, np.max))
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"


def _commonest(frames: list[Figures]) -> str:
    """The mean shares of the commonest classes."""
    names = {name for frame in frames for name in frame}
    mean = {name: float(np.mean([frame.get(name, 0.0) for frame in frames])) for name in names}
    top = sorted(names, key=lambda name: (-mean[name], name))[:TOP_CLASSES]
    return ", ".join(f"{name} {mean[name]:.1%}" for name in top)


def main(
    *,
    seeds: int = 10,
    frames: int = 10,
    lens: tuple[SynthLens, ...] = ("standard",),
    drive: tuple[Path, ...] = (),
) -> Iterator[str]:
    """Print the table: a column for synthetic rigs of each lens, and one for each real drive."""
    columns = {
        f"synthetic, {each} lens, {seeds * frames} frames": list(synthetic_frames(each, seeds, frames))
        for each in lens
    }
    for each in drive:
        found = list(real_frames(each))
        columns[f"{each.name}, {len(found)} frame{'s' * (len(found) > 1)}"] = found
    header, *lines = table(" | ".join(["a frame", *columns]), rows([*columns.values()]))
    yield from (header, f"|---|{'---:|' * len(columns)}", *lines[1:])


if __name__ == "__main__":
    script(main)
