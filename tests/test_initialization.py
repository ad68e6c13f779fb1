import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semcal_cli import core
from semcal_cli.checks.other_mounting import MIN_RUNNER_UP_MARGIN, check_mountings
from semcal_cli.config import InitializationConfig
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.search.mounting import Mounting, runner_up
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, compare_poses, inverse, rotation_error_deg
from semcal_cli.observations.observations import LabelledCloud, Observations

RIGHT_DEG = 1.0  # images of 640 x 360 ascend on blocks of 2 pixels, a quarter of a degree
RIGHT_CM = 15.0


def from_nothing(
    observations: Observations, T_given: Pose | None = None, **changes: object
) -> tuple[Mounting, ...]:
    config = dataclasses.replace(InitializationConfig(), **changes)
    return search_mountings(observations, config, 0, T_given).hypotheses


def check(hypothesis: Mounting, T_true: Pose) -> None:
    error = compare_poses(hypothesis.T_camera_lidar, T_true)
    assert error.rotation_deg < RIGHT_DEG
    assert error.camera_center_cm < RIGHT_CM


def turned_about_z(T: Pose, angle_deg: float) -> Pose:
    """The camera turned about the LiDAR's z axis."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()
    return T @ inverse(turn)


@pytest.mark.parametrize("zoom", ["exact", "paper"])
def test_the_mounting_is_found(street_observations: Observations, street_truth: Pose, zoom: str) -> None:
    hypotheses = from_nothing(street_observations, zoom=zoom)
    check(hypotheses[0], street_truth)
    agreements = [core.agreement(street_observations.core, h.T_camera_lidar) for h in hypotheses]
    ranks = [agreement.mutual_information - agreement.bias for agreement in agreements]
    assert ranks == sorted(ranks, reverse=True)


@pytest.mark.parametrize(
    "by_deg",
    [(0.0, 0.0, 130.0), (180.0, 0.0, 0.0), (0.0, 90.0, 0.0), (-70.0, 0.0, 40.0)],
    ids=["about its axis", "upside down", "on its side", "tilted"],
)
def test_a_turned_lidar_turns_the_answer(
    by_deg: tuple[float, ...], street_observations: Observations, street_truth: Pose
) -> None:
    S = np.eye(4)
    S[:3, :3] = Rotation.from_rotvec(by_deg, degrees=True).as_matrix()
    turned = dataclasses.replace(street_observations, lidar=None).with_clouds(
        cloud.with_points((cloud.points @ S[:3, :3].T).astype(np.float32))
        for cloud in street_observations.clouds
    )
    check(from_nothing(turned)[0], street_truth @ inverse(S))


def test_a_portrait_camera_needs_all_rolls(street_observations: Observations, street_truth: Pose) -> None:
    """A quarter turn of the images is a roll of the camera by 90 degrees."""
    camera = street_observations.camera
    (fx, _, cx), (_, fy, cy), _ = camera.K
    # A pixel (u, v) goes to (v, width - 1 - u), so x becomes y and y becomes -x.
    K = ((fy, 0.0, cy), (0.0, fx, camera.width - 1.0 - cx), (0.0, 0.0, 1.0))
    portrait = dataclasses.replace(
        street_observations.with_images(
            image.with_classes(np.rot90(image.classes)) for image in street_observations.images
        ),
        camera=camera.model_copy(update={"width": camera.height, "height": camera.width, "K": K}),
    )
    quarter = np.array(
        [[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    check(from_nothing(portrait, max_roll_deg=180.0)[0], quarter @ street_truth)


def test_threads_do_not_change_a_bit(street_observations: Observations) -> None:
    found = []
    for num_threads in (1, 2):
        core.set_num_threads(num_threads)
        found.append(str(from_nothing(street_observations)))
    assert found[0] == found[1]


def test_without_a_lidar_block_the_grid_comes_from_the_points(
    street_observations: Observations, street_truth: Pose
) -> None:
    check(from_nothing(dataclasses.replace(street_observations, lidar=None))[0], street_truth)


def test_a_given_pose_narrows_the_search(street_observations: Observations, street_truth: Pose) -> None:
    check(
        from_nothing(street_observations, turned_about_z(street_truth, 20.0), search_deg=25.0)[0],
        street_truth,
    )
    # Where it looks elsewhere, the truth is not found: the ascents end within their own reach of where they began.
    elsewhere = turned_about_z(street_truth, 120.0)
    for hypothesis in from_nothing(street_observations, elsewhere, search_deg=20.0):
        assert rotation_error_deg(hypothesis.T_camera_lidar, street_truth) > 45.0


@pytest.mark.parametrize("is_led_astray", [False, True])
def test_ascents_that_end_apart_have_the_surroundings_searched(
    street_observations: Observations, street_truth: Pose, is_led_astray: bool
) -> None:
    """From a pose that leads nowhere, the search finds the truth; where ascents meet, nothing is searched."""
    alignment = InitializationConfig().alignment
    if is_led_astray:
        # One ascent stays where it is, the other one goes by blocks as large as half the image.
        alignment = dataclasses.replace(alignment, blocks_across_given=(), blocks_across_near=(2,))
    (found,) = from_nothing(street_observations, turned_about_z(street_truth, 3.0), alignment=alignment)
    # Only the registration counts pairs.
    assert (found.num_pairs is not None) == is_led_astray
    assert rotation_error_deg(found.T_camera_lidar, street_truth) < RIGHT_DEG


def test_the_camera_stays_within_the_baseline(street_observations: Observations) -> None:
    near = dataclasses.replace(street_observations, max_baseline_m=0.05)
    for hypothesis in search_mountings(near, InitializationConfig(), seed=0).hypotheses:
        assert np.linalg.norm(camera_center(hypothesis.T_camera_lidar)) < 0.051


def test_a_runner_up_says_something_else(street_observations: Observations) -> None:
    config = InitializationConfig()
    found = search_mountings(street_observations, config, seed=0)
    best, *_ = found.hypotheses
    other = runner_up(found.hypotheses, config.runner_up_deg)
    assert other is not None
    assert rotation_error_deg(other.T_camera_lidar, best.T_camera_lidar) >= config.runner_up_deg
    assert found.runner_up_margin == best.margin(other)
    assert found.runner_up_margin > MIN_RUNNER_UP_MARGIN
    assert check_mountings(found) == ()


def test_a_scene_that_looks_the_same_both_ways_is_not_clear(street_observations: Observations) -> None:
    """Each sweep is doubled by its own half turn, so that two opposite mountings explain the images alike."""
    half_turn = np.float32([-1.0, -1.0, 1.0])
    doubled = street_observations.with_clouds(
        LabelledCloud(
            np.concatenate([cloud.points, cloud.points * half_turn]),
            np.concatenate([cloud.classes, cloud.classes]),
        )
        for cloud in street_observations.clouds
    )
    config = InitializationConfig()
    found = search_mountings(doubled, config, seed=0)
    best, *_ = found.hypotheses
    other = runner_up(found.hypotheses, config.runner_up_deg)
    assert other is not None
    assert rotation_error_deg(other.T_camera_lidar, best.T_camera_lidar) > 170.0
    assert best.margin(other) < MIN_RUNNER_UP_MARGIN
    (finding,) = check_mountings(found)
    assert finding.sentence.startswith(f"a mounting {other.rotation_from_best_deg:.0f} degrees away ")


def hypothesis(nats: float, sigma_nats: float | None) -> Mounting:
    return Mounting(
        T_camera_lidar=np.eye(4),
        mutual_information_nats=nats,
        bias_nats=0.1,
        sigma_nats=sigma_nats,
        overlap=0.5,
        num_pairs=None,
        num_inliers=None,
        rotation_from_best_deg=0.0,
    )


@pytest.mark.parametrize(("sigma_nats", "margin"), [(0.04, 2.0), (None, 0.0)])
def test_a_margin_is_in_standard_errors_of_the_difference(sigma_nats: float | None, margin: float) -> None:
    assert hypothesis(1.1, 0.03).margin(hypothesis(1.0, sigma_nats)) == pytest.approx(margin)
    assert hypothesis(1.1, 0.0).margin(hypothesis(1.0, 0.0)) == 0.0  # no scatter, no known error


def test_images_without_labels_overlap_nothing(street_observations: Observations) -> None:
    blank = street_observations.with_images(
        image.with_classes(np.full_like(image.classes, 255)) for image in street_observations.images
    )
    with pytest.raises(CalibrationError, match="no overlap: labelled points meet labelled pixels in none of"):
        from_nothing(blank)


def test_a_lidar_block_of_another_sensor_is_refused(street_observations: Observations) -> None:
    lidar = street_observations.lidar
    assert lidar is not None
    other = lidar.model_copy(update={"fov_up_deg": 10.0, "fov_down_deg": -5.0})
    with pytest.raises(
        InputError, match=r"lidar.fov_down_deg, lidar.fov_up_deg: found \d+% of the points outside"
    ):
        from_nothing(dataclasses.replace(street_observations, lidar=other))
