"""Whether clouds look like metres: heights of the sensor, of cars and of people, and ranges.

The pose's translation has the scale of the clouds, and labels agree equally well at any scale. Only known sizes reveal
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import cv2
import numpy as np

from semcal_cli.checks.wrong_origin import WRONG_ORIGIN
from semcal_cli.estimation.search.ray_origin import place_text
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Numbers, Points, Vectors
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.observations.observations import LabelledCloud, Observations

CLOUD_UNIT = Check(
    topic="cloud-unit",
    entry=Entry(
        title="Clouds may not be in metres",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "clouds may not be in metres, but in feet: cars are 4.9 m high (median of 14), usually 1.55; the "
                "sensor's height above the ground is 5.6 m, usually 0.1 to 5"
            ),
        ),
        meaning=(
            "Ranges, the sensor's height, or the heights of cars and people are unusual. The pose's translation has "
            "the scale of the clouds, and labels agree equally well at any scale."
        ),
        cause="The clouds are in feet or millimetres, or were scaled.",
        remedy="Convert the clouds to metres. Where the scene is unusual, the note changes no verdict.",
        figure="Difference of the sizes of cars and people from typical ones, as a share.",
    ),
    settings={
        "": Limit(
            at_most=0.12,
            unit="%",
            source=(
                "cars and people of one country are up to 7 % larger or smaller than the mean, so a scale of 0.95 "
                "cannot be told; of 42 synthetic drives of six rigs with four frames or more, none was noted as they "
                "are or scaled by 0.95, and all were noted scaled by 0.8, by 1.2 and in feet"
            ),
        )
    },
)
FAR_POINTS = Check(
    topic="far-points",
    advice="clouds must be in the LiDAR frame",
    entry=Entry(
        title="Points are very far away",
        section=PageSection.INSPECTION,
        quotes=("half of the points are 4,512,345 m away or more: clouds must be in the LiDAR frame",),
        meaning="The points are farther from the origin than any LiDAR measures.",
        cause="The clouds are in a map's frame, such as UTM, and not in that of the LiDAR.",
        remedy="Transform the clouds into the LiDAR's frame, each with its own pose.",
        figure="Median range of the points.",
    ),
    settings={
        "": Limit(
            at_most=1000.0,
            unit="m",
            source="a choice, beyond the range of any LiDAR on a vehicle; it was not measured",
        )
    },
)
TOLERANCE = CLOUD_UNIT.limit()
"""Largest difference of sizes from typical ones without a note, as a share."""
NUM_FRAMES = 4
"""Number of frames that are measured."""
GROUND = (
    "road road_line lane_marking sidewalk parking ground other_ground terrain grass dirt asphalt concrete "
    "driveable_surface flat puddle mud"
)
NAMES = {"ground": GROUND, "cars": "car cars", "people": "person people pedestrian pedestrians human"}
"""Class names of the ground, and of each kind of things whose heights are known."""
HEIGHTS_M = {"cars": 1.55, "people": 1.72}
"""Typical heights in metres, as they are measured here. The mean of cars built in Europe was 1.48 m in 2000 and 1.55 m
in 2022 (Inovev). Those of men and women over all countries are about 1.71 and 1.59 m without shoes, and 5 to 10 cm more
in Europe (NCD-RisC, *A century of trends in adult human height*, eLife 2016). The cars of a KITTI drive have a median
of 1.51 m here. Those of 42 synthetic drives have 1.52 to 1.72 m, the highest with 16 channels, and their people 1.70 to
1.81 m."""
MIN_THINGS = 6
"""Smallest number of things of a kind whose heights count."""
MIN_POINTS = 25
"""Smallest number of points of a thing."""
REACH = 12.0
"""Distance within which things are measured, in heights of the sensor. Beams are dense enough there."""
CELL = 0.2
"""Side of the cells that separate things, in heights of the sensor above the ground."""
MIN_GROUND = 100
"""Smallest number of points of the ground to which a plane is fitted."""
MAX_GROUND = 3000
"""Number of points of the ground in each frame that things stand on, about; more only cost time."""
TOP = 0.98
"""Quantile of the heights of a thing's points that counts as its height; wrong labels lie above."""
SENSOR_HEIGHTS_M = 0.1, 5.0
"""Heights of sensors above the ground: from a robot's to a lorry's."""
RANGES_M = 0.5, 100.0
"""Medians of ranges, indoors and on roads."""
UNITS = {"feet": 3.28084, "inches": 39.3701, "centimetres": 100.0, "millimetres": 1000.0}
"""Units for each metre."""
NEAR_UNIT = 0.2
"""Largest logarithm of a ratio of sizes over the scale of a unit that names the unit."""


def check_range(range_m: float) -> tuple[Finding, ...]:
    """Check the median range of the points, which shows clouds that are in the frame of a map."""
    return FAR_POINTS.measured(range_m, f"half of the points are {range_m:,.0f} m away or more").findings


def check_scale(observations: Observations) -> tuple[Finding, ...]:
    """Compare ranges, the sensor's height and sizes with what is usual.

    Args:
        observations: Vectors with classes; the names of the classes tell what is ground, a car or a person.

    Returns:
        A finding if the clouds may not be in metres, or if the stated place of the rays makes it look so.
    """
    few = evenly_spaced(range(observations.num_frames), NUM_FRAMES)
    clouds = [observations.clouds[index] for index in few]
    plain = [
        name.strip().lower().replace(" ", "_").replace("-", "_") for name in observations.point_class_names
    ]
    classes = {
        kind: [index for index, name in enumerate(plain) if name in names.split()]
        for kind, names in NAMES.items()
    }
    rays = [cloud.with_points(observations.rays(cloud.points)) for cloud in clouds]
    return _judge(_measures(rays, classes), observations.origin_m, lambda: _measures(clouds, classes))


def check_ranges(rays: Sequence[Points], origin_m: Sequence[float]) -> tuple[Finding, ...]:
    """Compare ranges alone with what is usual, as `check_scale` does.

    Args:
        rays: Vectors (N, 3) of each sweep from the stated place of the rays to the points, metres.
        origin_m: That place (3,), metres, LiDAR frame.
    """
    return _judge(
        Measures(_median_range_m(rays)),
        origin_m,
        lambda: Measures(_median_range_m([of_one + np.asarray(origin_m, np.float32) for of_one in rays])),
    )


def _judge(
    measures: Measures, origin_m: Sequence[float], from_zero: Callable[[], Measures]
) -> tuple[Finding, ...]:
    """Blame the stated place of the rays, from which `measures` are, where those from the points' origin are usual."""
    findings = judge_scale(measures)
    if not (findings and any(origin_m)) or judge_scale(from_zero()):
        return findings
    stated = f"`origin_m: {place_text(np.array(origin_m))}` under `lidar:` may be wrong"
    seen = f"seen from there, {'; '.join(measures.unusual)}, and seen from the origin of the points, all is as usual"
    return (WRONG_ORIGIN.finding(f"{stated}: {seen}"),)


def judge_scale(measures: Measures) -> tuple[Finding, ...]:
    """Judge the measures of a drive, which are in metres if the clouds are."""
    if not (unusual := measures.unusual):
        return ()
    return (CLOUD_UNIT.finding(f"clouds may not be in metres{measures.unit_text}: {'; '.join(unusual)}"),)


class Measures(NamedTuple):
    """What is measured of a drive, in the unit of its clouds."""

    range_m: float
    """Median range of the points."""
    sensors_m: Sequence[float] = ()
    """Heights of the sensor above the ground."""
    heights_m: Mapping[str, Numbers] = MappingProxyType({})
    """Heights of the things of each kind."""

    @property
    def unit_text(self) -> str:
        """The unit that sizes suggest, or their ratio to the usual ones; empty if they are as usual."""
        if (ratio := _ratio(self.heights_m)) is None:
            return ""
        unit, scale = min(UNITS.items(), key=lambda item: abs(math.log(ratio / item[1])))
        is_unit = abs(math.log(ratio / scale)) < NEAR_UNIT
        return f", but in {unit}" if is_unit else f", because sizes are {ratio:.2f} times the usual ones"

    @property
    def unusual(self) -> list[str]:
        """The measures that are not as usual, each with what is."""
        unusual = list[str]()
        if _ratio(self.heights_m) is not None:
            unusual = [
                f"{kind} are {np.median(heights):.3g} m high (median of {len(heights)}), usually {HEIGHTS_M[kind]:g}"
                for kind, heights in self.heights_m.items()
            ]
        measures = [("half of the points are within", self.range_m, RANGES_M)]
        if self.sensors_m:
            height_m = float(np.median(self.sensors_m))
            measures.insert(0, ("the sensor's height above the ground is", height_m, SENSOR_HEIGHTS_M))
        for what, value_m, (low, high) in measures:
            if not low <= value_m <= high:
                unusual.append(f"{what} {value_m:,.3g} m, usually {low:g} to {high:g}")
        return unusual


def _measures(clouds: Sequence[LabelledCloud], classes: Mapping[str, Sequence[int]]) -> Measures:
    measured = [heights for cloud in clouds if (heights := _measure(cloud, classes)) is not None]
    heights_by_kind = {
        kind: [height for _, heights in measured for height in heights[kind]] for kind in HEIGHTS_M
    }
    heights_m = {
        kind: np.array(values) for kind, values in heights_by_kind.items() if len(values) >= MIN_THINGS
    }
    return Measures(
        _median_range_m([cloud.points for cloud in clouds]), [sensor_m for sensor_m, _ in measured], heights_m
    )


def _median_range_m(rays: Sequence[Points]) -> float:
    return float(np.median(np.concatenate([np.linalg.norm(of_one, axis=1) for of_one in rays])))


def _ratio(heights_m: Mapping[str, Numbers]) -> float | None:
    """Compare heights with typical ones; None if the ratio is as usual, or nothing was measured."""
    if not heights_m:
        return None
    logs, weights = [], []
    for kind, heights in heights_m.items():
        middle = float(np.median(heights))
        scatter = 1.4826 * float(np.median(np.abs(np.log(heights / middle))))
        logs.append(math.log(middle / HEIGHTS_M[kind]))
        # The variance of a median of normal numbers, and that of means of countries.
        weights.append(1.0 / (0.5 * math.pi * scatter**2 / len(heights) + (0.5 * TOLERANCE) ** 2))
    mean = float(np.average(logs, weights=weights))
    return math.exp(mean) if abs(mean) > max(TOLERANCE, 2.0 / math.sqrt(sum(weights))) else None


def _measure(
    cloud: LabelledCloud, classes: Mapping[str, Sequence[int]]
) -> tuple[float, dict[str, list[float]]] | None:
    """Measure the heights of the sensor and of the things of each kind above the ground; None without ground.

    A plane is fitted to the near points of the ground, whichever way the sensor is mounted.
    """
    is_ground = np.isin(cloud.classes, classes["ground"])
    ground = cloud.points[is_ground].astype(np.float64)
    if len(ground) < MIN_GROUND:
        return None
    ground = ground[:: max(len(ground) // MAX_GROUND, 1)]
    ranges = np.linalg.norm(ground, axis=1)
    fitted = lower = ground[ranges <= np.median(ranges)]
    for _ in range(5):
        middle = fitted.mean(axis=0)
        up = np.linalg.eigh(np.cov((fitted - middle).T))[1][:, 0]
        off = np.abs((lower - middle) @ up)
        fitted = lower[off <= max(2.5 * 1.4826 * float(np.median(off)), 1e-9)]
    sensor_m = float(-middle @ up)
    if sensor_m < 0.0:
        up, sensor_m = -up, -sensor_m
    across = np.linalg.svd(up[None])[2][1:]
    is_near = np.einsum("ij,ij->i", cloud.points, cloud.points) < (REACH * sensor_m) ** 2
    points = cloud.points[is_near] @ np.vstack([across, up]).T
    points[:, 2] += sensor_m

    def near(kind: str) -> Vectors:
        return np.asarray(points[np.isin(cloud.classes[is_near], classes[kind])])

    ground = near("ground")
    ground = ground[:: max(len(ground) // MAX_GROUND, 1)]
    return sensor_m, {kind: list(_heights(near(kind), ground, sensor_m)) for kind in HEIGHTS_M}


def _heights(points: Vectors, ground: Vectors, sensor_m: float) -> Iterator[float]:
    """Measure the things of one kind in one cloud: clusters of neighbouring cells with points of the kind."""
    if len(points) < MIN_POINTS:
        return
    cells = np.floor(points[:, :2] / (CELL * sensor_m)).astype(int)
    cells -= cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0) + 1, np.uint8)
    occupied[tuple(cells.T)] = 1
    num_clusters, clusters = cv2.connectedComponents(occupied, connectivity=8)
    cluster_of_point = clusters[tuple(cells.T)]
    for index in range(1, num_clusters):  # 0 is what is not occupied.
        thing = points[cluster_of_point == index]
        if len(thing) >= MIN_POINTS and (height := _height(thing, ground, sensor_m)) is not None:
            yield height


def _height(thing: Vectors, ground: Vectors, sensor_m: float) -> float | None:
    """Measure the height of a thing above the ground around it; None where no beam hits its foot or the ground."""
    middle = np.median(thing[:, :2], axis=0)
    around = ground[np.abs(ground[:, :2] - middle).max(axis=1) < 2.0 * sensor_m]
    if len(around) < 10:
        return None
    heights = thing[:, 2] - np.median(around[:, 2])
    distance_m = float(np.hypot(*middle))
    elevations = np.arctan2(thing[:, 2] - sensor_m, np.hypot(thing[:, 0], thing[:, 1]))
    # The next beam above the thing misses it, so half of the distance between beams is added.
    num_gaps = int(np.count_nonzero(np.diff(np.sort(elevations)) > math.radians(0.1)))
    gap_m = distance_m * float(np.ptp(elevations)) / max(num_gaps, 1)
    top_m = float(np.quantile(heights, TOP))
    is_whole = heights.min() < 0.4 * top_m and gap_m < 0.5 * top_m
    return top_m + 0.5 * gap_m if is_whole and top_m > 0.0 else None
