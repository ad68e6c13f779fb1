from pathlib import Path

import cv2
import numpy as np
import pytest

from semcal_cli.classes import NO_CLASS
from semcal_cli.drive import Camera, Drive, Frame
from semcal_cli.errors import InputError
from semcal_cli.observations import Observations
from semcal_cli.overlay import before_after, class_colors, draw_legend, draw_overlay, write_overlay

CAMERA = Camera(
    model="plumb_bob", width=640, height=360, K=((320.0, 0.0, 319.5), (0.0, 320.0, 179.5), (0.0, 0.0, 1.0))
)
NAMES = ("car", "17")
BLACK = np.zeros((360, 640, 3), dtype=np.uint8)
# The camera looks along the LiDAR's x axis from 0.5 m to its right: with parallax, points can be hidden.
T_CAMERA_LIDAR = np.array([[0, -1, 0, -0.5], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


def point(u: int, v: int, depth: float) -> list[float]:
    """The point (LiDAR frame) that lands on a pixel at a depth."""
    x, y = depth * (u - 319.5) / 320, depth * (v - 179.5) / 320
    return [depth, -x - 0.5, -y]


def draw(points: list[list[float]], classes: list[int]) -> np.ndarray:
    return draw_overlay(
        BLACK,
        np.array(points, dtype=np.float32),
        np.array(classes, dtype=np.uint8),
        T_CAMERA_LIDAR,
        CAMERA,
        class_colors(NAMES),
    )


@pytest.mark.parametrize("index", [0, 1])
def test_a_point_paints_its_pixel_in_the_color_of_its_class(index: int) -> None:
    picture = draw([point(100, 200, 8.0)], [index])
    np.testing.assert_array_equal(picture[200, 100], class_colors(NAMES)[index])
    v, u = np.nonzero(picture.any(axis=2))
    assert (u.mean(), v.mean()) == (100, 200)
    assert len(u) <= 9


def test_points_behind_outside_and_without_a_class_are_left_out() -> None:
    beyond, behind = point(700, 200, 8.0), point(100, 200, -8.0)
    assert not draw([beyond, behind, point(100, 200, 8.0)], [0, 0, NO_CLASS]).any()


def test_hidden_points_are_left_out() -> None:
    """Points at 50 m are hidden by a wall at 2 m that covers columns 0 to 300, and seen beside it."""
    wall = [point(u, v, 2.0) for u in range(0, 300, 3) for v in range(0, 360, 3)]
    far = [point(u, 181, 50.0) for u in (100, 200, 500)]
    picture = draw(wall + far, [0] * len(wall) + [1] * len(far))
    seen = (picture == class_colors(NAMES)[1]).all(axis=2)
    assert set(np.nonzero(seen)[1].tolist()) <= set(range(497, 504))
    assert seen[181, 500]


def test_colors_are_fixed_and_distinct() -> None:
    names = ["road", "car", *(str(i) for i in range(15))]
    colors = class_colors(names)
    assert len(np.unique(colors, axis=0)) == len(names)
    np.testing.assert_array_equal(class_colors(names), colors)
    np.testing.assert_array_equal(class_colors(["car"])[0], colors[1])


def test_legend_and_panels_have_the_width_they_are_given() -> None:
    many = [f"class {i}" for i in range(40)]
    assert draw_legend(many, class_colors(many), 640).shape[1] == 640
    both = {"before": BLACK, "after": BLACK}
    assert before_after(both).shape[1] == 1280
    assert before_after(both, stacked=True).shape[1] == 640


def observed(image: str | None) -> tuple[Drive, Observations]:
    drive = Drive(semcal_drive=1, camera=CAMERA, frames=(Frame(points="a.bin", image=image),))
    classes = np.full((360, 640), NO_CLASS, dtype=np.uint8)
    classes[:180] = 1
    cloud = np.array([point(100, 200, 8.0)], dtype=np.float32)
    observations = Observations(CAMERA, None, [cloud], [np.zeros(1, np.uint8)], [classes], NAMES, NAMES)
    return drive, observations


def test_without_a_picture_the_label_image_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "overlay.png"
    write_overlay(*observed(None), {"truth": T_CAMERA_LIDAR}, 0, path)
    picture = cv2.imread(str(path))
    caption = np.flatnonzero((picture[:, 320] == class_colors(NAMES)[1] // 2).all(axis=1))[0]
    np.testing.assert_array_equal(picture[caption + 200, 100], class_colors(NAMES)[0])
    assert [p.name for p in tmp_path.iterdir()] == ["overlay.png"]


def test_wrong_input(tmp_path: Path) -> None:
    small = str(tmp_path / "small.png")
    cv2.imwrite(small, BLACK[:100])
    poses = {"truth": T_CAMERA_LIDAR}
    with pytest.raises(InputError, match=r"small.png: found 640 x 100 pixels, needed 640 x 360"):
        write_overlay(*observed(small), poses, 0, tmp_path / "o.png")
    with pytest.raises(InputError, match=r"missing.jpg: no such file or folder"):
        write_overlay(*observed("missing.jpg"), poses, 0, tmp_path / "o.png")
    with pytest.raises(InputError, match=r"found 1 frames, needed one numbered 1"):
        write_overlay(*observed(None), poses, 1, tmp_path / "o.png")
    with pytest.raises(InputError, match=r"o.jpg: found suffix '.jpg', needed .png"):
        write_overlay(*observed(None), poses, 0, tmp_path / "o.jpg")
    assert [p.name for p in tmp_path.iterdir()] == ["small.png"]
