from dataclasses import replace

import numpy as np
import pytest
from conftest import make_pose

from semcal_cli.checks.scale import Measures, check_ranges, check_scale, judge_scale
from semcal_cli.drive.lidar import Lidar
from semcal_cli.observations.observations import Observations


def scaled(observations: Observations, scale: float, turn: np.ndarray | None = None) -> Observations:
    """Multiply and turn all points."""
    matrix = (np.eye(3) if turn is None else turn) * scale
    return observations.with_clouds(
        cloud.with_points((cloud.points @ matrix.T).astype(np.float32)) for cloud in observations.clouds
    )


def test_metres_are_not_noted(street_observations: Observations) -> None:
    assert check_scale(street_observations) == ()
    assert check_scale(scaled(street_observations, 1.0, make_pose((1.3, 0.4, -2.0), (0, 0, 0))[:3, :3])) == ()


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        (3.28084, "clouds may not be in metres, but in feet: "),
        (1000.0, "clouds may not be in metres, but in millimetres: "),
        (1.2, "clouds may not be in metres, because sizes are 1.2"),
        (0.8, "clouds may not be in metres, because sizes are 0.8"),
    ],
)
def test_other_units_are_noted(street_observations: Observations, scale: float, said: str) -> None:
    (finding,) = check_scale(scaled(street_observations, scale))
    assert finding.sentence.startswith(said)
    assert "people are " in finding.sentence


def test_without_names_only_ranges_tell(street_observations: Observations) -> None:
    names = [str(index) for index in range(len(street_observations.point_class_names))]
    unnamed = replace(street_observations, point_class_names=names)
    assert check_scale(unnamed) == ()
    assert check_scale(scaled(unnamed, 3.28084)) == ()
    (finding,) = check_scale(scaled(unnamed, 1000.0))
    assert finding.sentence.endswith(" m, usually 0.5 to 100")


def test_a_sensor_on_a_mast() -> None:
    (finding,) = judge_scale(Measures(20.0, [8.9, 9.0, 9.2], {"cars": np.full(20, 1.5)}))
    assert finding.sentence == (
        "clouds may not be in metres: the sensor's height above the ground is 9 m, usually 0.1 to 5"
    )


def test_cars_and_people_speak_together() -> None:
    high, low = np.full(9, 1.55 * 1.2), np.full(9, 1.72 / 1.2)
    assert judge_scale(Measures(9.0, [1.8], {"cars": high, "people": low})) == ()
    (finding,) = judge_scale(Measures(9.0, [1.8], {"cars": high, "people": np.full(9, 1.72 * 1.2)}))
    assert finding.sentence == (
        "clouds may not be in metres, because sizes are 1.20 times the usual ones: cars are 1.86 m high (median of 9), "
        "usually 1.55; people are 2.06 m high (median of 9), usually 1.72"
    )


STATED = "`origin_m: [0.00, 0.00, 100.00]` under `lidar:` may be wrong: seen from there, "
AS_USUAL = "and seen from the origin of the points, all is as usual: edges, segments and occlusion need the true place"


def test_a_stated_origin_far_away_is_named_and_not_the_unit(street_observations: Observations) -> None:
    stated = replace(street_observations, lidar=Lidar(origin_m=(0.0, 0.0, 100.0)))
    (finding,) = check_scale(stated)
    assert finding.sentence.startswith(f"{STATED}the sensor's height above the ground is ")
    assert finding.sentence.endswith(AS_USUAL)
    (finding,) = check_scale(scaled(stated, 1000.0))
    assert finding.sentence.startswith("clouds may not be in metres, but in millimetres: ")


def test_without_labels_ranges_tell_a_stated_origin_far_away(street_observations: Observations) -> None:
    points = [cloud.points for cloud in street_observations.clouds]
    origin_m = (0.0, 0.0, 100.0)
    (finding,) = check_ranges([of_one - np.array(origin_m, np.float32) for of_one in points], origin_m)
    assert finding.sentence.startswith(f"{STATED}half of the points are within 10")
    assert finding.sentence.endswith(AS_USUAL)
    assert check_ranges(points, (0.0, 0.0, 0.0)) == ()
