"""What is an edge of a sweep and of an image, and how strong it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import FINE_STREET

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.observations.cues.edges import (
    EDGES,
    NO_EDGE,
    EdgesConfig,
    edges_of_sweeps,
    gradients,
)
from semcal_cli.observations.observations import NO_CLASS
from semcal_cli.observations.reading import read_clouds


def test_points_with_and_without_edges(fine_street: Path) -> None:
    drive = read_drive(fine_street)
    clouds = read_clouds(drive)
    found = edges_of_sweeps(clouds)
    assert found.names[0] == "no edge"
    assert len(found.names) == 7
    for cloud, classes, to_steps in zip(clouds, found.classes, found.to_steps_m, strict=True):
        is_edge = (classes != NO_CLASS) & (classes != NO_EDGE)
        assert 0.02 < is_edge.mean() < 0.5
        # Of those without an edge, about `plain_per_edge` for each with one are compared.
        assert np.sum(classes == NO_EDGE) <= 1.1 * EDGES.plain_per_edge * is_edge.sum()
        assert not to_steps[~is_edge].any()
        ranges = np.linalg.norm(cloud.points, axis=1)
        # Half-way to a neighbour that is at most `REACH` of the core, 0.02 radians, away, and a little higher or lower.
        assert (np.linalg.norm(to_steps, axis=1) <= 0.011 * ranges + 1e-6).all()
    assert found.spacing == pytest.approx(np.radians(360.0 / FINE_STREET.columns), rel=0.05)


def test_an_edge_is_as_strong_in_the_shade_beside_the_light(fine_street: Path) -> None:
    camera = read_drive(fine_street).camera
    width, height = camera.size
    image = np.full((height, width, 3), 200, np.uint8)
    image[:, width // 2 + 20 :] = 150
    image[height // 2 :] //= 4
    strength, is_inside = gradients(camera, image, np.ones((height, width), bool), 1.0)
    light, shade = (strength[height // 2 + side, is_inside[height // 2]].max() for side in (-30, 30))
    assert light > 0.0
    assert shade == pytest.approx(light, rel=0.15)


def test_rings_tell_which_rays_are_neighbours() -> None:
    # Lasers 20 cm above the origin: a pole 2 m away seems to be higher than the wall that they see beside it.
    azimuths, elevations = np.radians(np.arange(360.0)), np.array([0.0, 0.02])
    ranges = np.where(np.arange(360) == 90, 2.0, 10.0)
    along = ranges[:, None] * np.cos(elevations)
    points = np.stack(
        [
            along * np.cos(azimuths)[:, None],
            along * np.sin(azimuths)[:, None],
            ranges[:, None] * np.sin(elevations) + 0.2,
        ],
        axis=-1,
    )
    points = points.reshape(-1, 3).astype(np.float32)
    rings = np.tile(np.arange(2, dtype=np.uint16), 360)
    (steps,) = core.edge_steps([(points, None, rings)], EDGES.same_surface_m)
    np.testing.assert_array_equal(np.flatnonzero(steps.range_m > 1.0), [180, 181])
    assert np.isfinite(steps.range_m[[180, 181]]).all()
    (by_elevation,) = core.edge_steps([(points, None, None)], EDGES.same_surface_m)
    assert np.isinf(by_elevation.range_m[[180, 181]]).all()
    with pytest.raises(ValueError, match="719 intensities or rings of 720 points"):
        core.edge_steps([(points, None, rings[1:])], EDGES.same_surface_m)


def test_gradients_of_the_road_are_not_compared_with_those_of_the_horizon(fine_street: Path) -> None:
    camera = read_drive(fine_street).camera
    texture = np.random.default_rng(0).normal(0.0, 40.0, (camera.height, camera.width))
    horizon = camera.height // 2
    texture[horizon:] /= 4.0
    image = np.repeat((128.0 + texture)[:, :, None].clip(0, 255), 3, axis=2).astype(np.uint8)
    seen_everywhere = np.ones((camera.height, camera.width), bool)
    px_per_deg = core_camera(camera).pixels_per_radian * np.pi / 180.0

    def weakened(config: EdgesConfig) -> float:
        strength, _ = gradients(camera, image, seen_everywhere, 1.5, config)
        near, far = (strength[horizon + int(below_deg * px_per_deg)].mean() for below_deg in (5.0, 15.0))
        return float(near / far)

    assert weakened(EDGES) > 0.95
    assert weakened(replace(EDGES, surroundings_across_deg=6.0)) < 0.85
