"""Points drawn on images: which, where, in which order, and in which colours."""

import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import invoke
from conftest import without

from semcal_cli import core
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.cues.segments import SegmentationConfig
from semcal_cli.observations.observations import (
    NO_CLASS,
    FrameObservation,
    LabelledCloud,
    LabelledImage,
    Observations,
)
from semcal_cli.observations.reading import load_observations
from semcal_cli.report.colors import (
    NO_EDGE_NAME,
    STEP_COLORS,
    class_colors,
    coloring_of,
    depth_levels,
    level_colors,
    segment_colors,
)
from semcal_cli.report.dots import DotStyle, draw_dots
from semcal_cli.report.overlays import (
    GREY_STRENGTH,
    Overlays,
    before_after,
    draw_legend,
    edge_image,
)
from semcal_cli.report.points import View, associated_classes, frame_points, points_in_image

CAMERA = Camera(
    model="plumb_bob", width=640, height=360, K=((320.0, 0.0, 319.5), (0.0, 320.0, 179.5), (0.0, 0.0, 1.0))
)
NAMES = ("car", "17")
CAR, OTHER = class_colors(NAMES)
EDGE_NAMES = (NO_EDGE_NAME, *STEP_COLORS)
RANGE_3, INTENSITY_1 = EDGE_NAMES.index("range step 3"), EDGE_NAMES.index("intensity step 1")
STEP_COLUMN, STEP_ROW = 400, 250
"""Where the image of `draw_edges` steps: its right part is brighter, and so is its lower part."""
# The camera looks along the LiDAR's x axis from 0.5 m to its right: with parallax, points can be hidden.
T_CAMERA_LIDAR = np.array([[0, -1, 0, -0.5], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
WALL = [(u, v, 2.0) for u in range(0, 300, 3) for v in range(0, 360, 3)]
BEHIND = [(u, 181, 50.0) for u in (100, 200, 500)]
"""Points at 50 m of which a wall at 2 m hides two."""


def make(
    points: Sequence[tuple[int, int, float]],
    classes: Sequence[int],
    image: str | None = None,
    image_classes: np.ndarray | None = None,
    names: Sequence[str] = NAMES,
) -> tuple[Drive, Observations]:
    """A drive of one frame whose points land on the pixels (u, v) at some depths."""
    uvd = np.array(points, float).T
    x, y = uvd[2] * (uvd[0] - 319.5) / 320, uvd[2] * (uvd[1] - 179.5) / 320
    cloud = LabelledCloud(
        np.column_stack([uvd[2], -x - 0.5, -y]).astype(np.float32), np.array(classes, np.uint8)
    )
    pixels = np.full((360, 640), NO_CLASS, np.uint8) if image_classes is None else image_classes
    frame = FrameObservation(cloud, LabelledImage(pixels))
    drive = Drive(semcal_drive=1, camera=CAMERA, frames=(Frame(points="p.bin", image=image),))
    return drive, Observations(CAMERA, None, (frame,), names, NAMES)


def draw(points: Sequence[tuple[int, int, float]], classes: Sequence[int]) -> np.ndarray:
    """What the dots change of a black image."""
    images, _ = Overlays(*make(points, classes), {"it": T_CAMERA_LIDAR}).draw(0)
    return images["it"]


def draw_edges(folder: Path, points: Sequence[tuple[int, int, float]], classes: Sequence[int]) -> np.ndarray:
    """Draw points by edge on an image with two steps."""
    image = np.full((360, 640, 3), 60, np.uint8)
    image[:, STEP_COLUMN:] += 60
    image[STEP_ROW:] += 60
    cv2.imwrite(str(folder / "image.png"), image)
    drive, observations = make(points, classes, str(folder / "image.png"), names=EDGE_NAMES)
    images, legend = Overlays(drive, observations, {"it": T_CAMERA_LIDAR}, "edge").draw(0)
    assert set(legend) <= {*STEP_COLORS, "edge in the image"}
    return images["it"]


def color_of(index: int) -> list[int]:
    """Blue, green and red of a class of the cue edges."""
    return list(STEP_COLORS[EDGE_NAMES[index]][::-1])


def test_a_point_paints_its_pixel_in_the_color_of_its_class() -> None:
    image = draw([(100, 200, 8.0), (300, 200, 8.0)], [0, 1])
    np.testing.assert_array_equal(image[200, [100, 300]], [CAR, OTHER])
    v, u = np.nonzero(image[:, :200].any(axis=2))
    assert (u.mean(), v.mean()) == (100, 200)
    assert len(u) <= 9


def test_points_behind_outside_and_without_a_class_are_left_out() -> None:
    assert not draw([(700, 200, 8.0), (100, 200, -8.0), (100, 200, 8.0)], [0, 0, NO_CLASS]).any()


def test_hidden_points_are_left_out(tmp_path: Path) -> None:
    """Of classes and of edges: a wall without edges covers columns 0 to 300, and far points are seen beside it."""
    by_class = draw(WALL + BEHIND, [0] * len(WALL) + [1] * len(BEHIND))
    by_edge = draw_edges(tmp_path, WALL + BEHIND, [0] * len(WALL) + [RANGE_3] * len(BEHIND))
    for image, color in ((by_class, OTHER), (by_edge, color_of(RANGE_3))):
        is_far = (image == color).all(axis=2)
        assert set(np.nonzero(is_far)[1].tolist()) <= set(range(497, 504))
        assert is_far[181, 500]


def test_colors_are_fixed_and_distinct() -> None:
    names = ["road", "car", *(str(i) for i in range(60))]
    colors = class_colors(names)
    assert len(np.unique(colors, axis=0)) == len(names)
    np.testing.assert_array_equal(class_colors(["car"])[0], colors[1])
    near, far = level_colors(depth_levels(np.array([2.0, 100.0]))).astype(int)
    assert near[2] > near[0] + 50  # blue, green, red
    assert far[0] > far[2]


def test_legend_and_panels_have_the_width_they_are_given() -> None:
    assert draw_legend({f"class {i}": (i, i, i) for i in range(40)}, 640).shape[1] == 640
    both = dict.fromkeys(("before", "after"), np.zeros((360, 640, 3), np.uint8))
    assert before_after(both).shape[1] == 1280
    assert before_after(both, stacked=True).shape[1] == 640


def test_without_an_image_the_label_image_is_shown(tmp_path: Path) -> None:
    classes = np.full((360, 640), NO_CLASS, np.uint8)
    classes[:180] = 1
    drive, observations = make([(100, 200, 8.0)], [0], image_classes=classes)
    Overlays(drive, observations, {"truth": T_CAMERA_LIDAR}).write(0, tmp_path / "overlay.png")
    image = cv2.imread(str(tmp_path / "overlay.png"))
    caption = np.flatnonzero((image[:, 320] == OTHER // 2).all(axis=1))[0]
    np.testing.assert_array_equal(image[caption + 200, 100], CAR)
    assert [p.name for p in tmp_path.iterdir()] == ["overlay.png"]


@pytest.mark.parametrize(
    ("image", "frame", "name", "complaint"),
    [
        ("small.png", 0, "o.png", r"small.png: found 640 x 100 pixels, needed 640 x 360"),
        ("missing.jpg", 0, "o.png", r"missing.jpg: no such file or folder"),
        (None, 1, "o.png", r"found 1 frame, expected one numbered 1"),
        (None, 0, "o.jpg", r"o.jpg: found suffix '.jpg', expected .png"),
    ],
)
def test_wrong_input(image: str | None, frame: int, name: str, complaint: str, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((100, 640, 3), np.uint8))
    observed = make([(100, 200, 8.0)], [0], image and str(tmp_path / image))
    with pytest.raises(InputError, match=complaint):
        Overlays(*observed, {"truth": T_CAMERA_LIDAR}).write(frame, tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["small.png"]


def test_a_legend_names_no_ground_where_none_was_found(street_observations: Observations) -> None:
    cloud = street_observations.clouds[0]
    above = cloud.points[cloud.points[:, 2] > 1.0]
    for points, has_ground in ((cloud.points, True), (above, False)):
        (segmented,) = core.segment_sweeps([points], SegmentationConfig())
        names = " ".join(segment_colors(segmented)[1])
        assert names.startswith("ground") == has_ground
        assert ("no ground was found" in names) != has_ground


def test_labels_agree_best_at_the_truth(street_observations: Observations, street_truth: np.ndarray) -> None:
    moved = [street_truth.copy() for _ in range(3)]
    for T, by in zip(moved, (-0.3, 0.0, 0.3), strict=True):
        T[0, 3] += by
    views = [View(street_observations, T) for T in moved]
    together = associated_classes(views[1].agreement())
    left, middle, right = (pose.agreement or 0.0 for pose in frame_points(views, 0, together).poses)
    assert middle > 0.95
    assert max(left, right) < middle - 0.02


def test_a_drive_without_labels_is_shown_by_what_needs_none(drive: Path, tmp_path: Path) -> None:
    without(drive, "point_labels", "image_labels")
    for by, is_enough in (("depth", True), ("segment", True), ("edge", True), ("class", False)):
        result = invoke("overlay", drive, drive, "--by", by, "-o", tmp_path / by, "-q")
        assert (result.exit_code == 0) == is_enough
        assert (tmp_path / by).exists() == is_enough
    without(drive, "image")
    result = invoke("overlay", drive, drive, "--by", "edge", "-o", tmp_path / "out")
    assert str(result.exception).endswith(".image: found nothing, expected an image")


def test_the_strip_names_frame_agreement_and_pose(street: Path, street_truth: np.ndarray) -> None:
    drive = read_drive(street)
    overlays = Overlays(drive, load_observations(drive), {"truth": street_truth})
    name, share, agree, caption = re.split(r"   | % ", overlays.strip(0, "truth"))
    assert (name, agree, caption) == (Path(drive.frames[0].points).stem, "agree", "truth")
    assert 95.0 < float(share) <= 100.0
    assert overlays.strip(0, "truth") != overlays.strip(1, "truth")


def test_what_colours_say_where_it_is_not_asked(drive: Path, tmp_path: Path) -> None:
    """Agreement beside another transform; edges of the cue edges, also beside segments, which bring a pose near."""
    against = ["--against", drive]
    asked = {
        "agreement": [*against, "--by", "agreement"],
        "beside": against,
        "class beside": [*against, "--by", "class"],
        "edge": ["--by", "edge"],
        "edges": ["--cue", "edges"],
        "both": ["--cue", "segments,edges"],
        "labels": [],
        "class": ["--cue", "edges", "--by", "class"],
    }
    common = ["overlay", drive, drive, "--max-frames", "1", "-q"]
    for name, options in asked.items():
        assert invoke(*common, *options, "-o", tmp_path / name).exit_code == 0
    without(drive, "point_labels")
    for name, options in (("unlabelled", []), ("unlabelled beside", against)):
        assert invoke(*common, *options, "-o", tmp_path / name).exit_code == 0
    images = {path.parent.name: path.read_bytes() for path in tmp_path.glob("*/000000.png")}
    assert images["beside"] == images["agreement"] != images["class beside"]
    assert images["edge"] == images["edges"] == images["both"] == images["unlabelled"]
    assert len({images[name] for name in ("edge", "labels", "class")}) == 3
    beside = cv2.imdecode(np.frombuffer(images["unlabelled beside"], np.uint8), cv2.IMREAD_COLOR)
    assert (beside == color_of(RANGE_3)).all(axis=2).any()


# By edge.


def test_only_points_with_an_edge_are_drawn_and_in_the_colour_of_their_step(tmp_path: Path) -> None:
    classes = [*range(len(EDGE_NAMES)), NO_CLASS]
    columns = [40 * (1 + place) for place in range(len(classes))]
    drawn = draw_edges(tmp_path, [(u, 100, 8.0) for u in columns], classes)
    is_colored = (drawn != drawn[..., :1]).any(axis=2)
    for index, u in zip(classes, columns, strict=True):
        is_step = 0 < index < NO_CLASS
        assert is_colored[90:110, u - 10 : u + 10].any() == is_step
        assert not is_step or drawn[100, u].tolist() == color_of(index)
    assert not np.delete(is_colored, np.s_[90:110], axis=0).any()


def test_steps_from_left_to_right_are_white_on_a_dark_image(tmp_path: Path) -> None:
    """And those from above to below are not: the cue does not compare them."""
    drawn = draw_edges(tmp_path, [(100, 100, 8.0)], [0])[..., 0].astype(int)
    assert drawn[100, STEP_COLUMN] > 180
    beside = np.r_[20 : STEP_COLUMN - 20, STEP_COLUMN + 20 : 620]
    for v in (100, STEP_ROW, 340):
        assert drawn[v, beside].max() <= GREY_STRENGTH * 180


def test_a_strong_edge_lies_above_a_weak_one_that_is_nearer(tmp_path: Path) -> None:
    drawn = draw_edges(tmp_path, [(100, 100, 8.1), (100, 100, 8.0)], [RANGE_3, INTENSITY_1])
    assert drawn[100, 100].tolist() == color_of(RANGE_3)


def test_all_classes_of_the_cue_have_colours_of_edges(
    street: Path, street_observations: Observations
) -> None:
    edges = load_cues(read_drive(street), ("edges",))
    assert tuple(edges.point_class_names) == EDGE_NAMES
    assert coloring_of(edges) == "edge"
    assert coloring_of(street_observations) == "class"
    gradients = class_colors(edges.image_class_names).astype(int).sum(axis=1)
    assert (np.diff(gradients) > 0).all()


def test_edges_of_sweep_and_image_coincide_at_the_truth_alone(street: Path, street_truth: np.ndarray) -> None:
    """Strong steps in range lie on pixels that are drawn brighter than with the camera turned by a degree."""
    drive = read_drive(street)
    observations, brightness = load_cues(drive, ("edges",)), []
    for turn_deg in (-1.0, 0.0, 1.0):
        T = apply_twist(street_truth, np.array([0.0, 0.0, 0.0, 0.0, np.radians(turn_deg), 0.0]))
        values = []
        for index, cloud in enumerate(observations.clouds):
            seen = points_in_image(cloud.points, T, observations.camera)
            shown = ~seen.is_hidden & (cloud.classes[seen.indices] == RANGE_3)
            u, v = seen.pixels[shown].clip(0, (639, 359)).T
            values.append(edge_image(drive, observations, index)[v, u, 0])
        brightness.append(float(np.concatenate(values).mean()))
    # Foliage is full of edges, which lie on edges of the image at any pose.
    assert brightness[1] > 1.05 * max(brightness[0], brightness[2])


def test_points_have_a_size_an_opacity_and_an_outline() -> None:
    """A red point on a grey image, drawn in four ways."""
    grey, red = np.full((40, 40, 3), 100, np.uint8), np.array([[0, 0, 200]], np.uint8)
    small, large, pale, outlined = (
        draw_dots(grey, np.array([[20, 20]]), red, style)
        for style in (DotStyle(), DotStyle(3), DotStyle(3, 0.5), DotStyle(3, has_outline=True))
    )
    changed = [int((drawing != grey).any(axis=2).sum()) for drawing in (small, large, pale, outlined)]
    assert changed[0] < changed[1] == changed[2] < changed[3]
    middles = [drawing[20, 20].tolist() for drawing in (large, pale, outlined)]
    assert middles == [[0, 0, 200], [50, 50, 150], [0, 0, 200]]
    assert (outlined[20, 24] == 0).all()
