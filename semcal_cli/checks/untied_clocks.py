"""Whether anything ties the images to the moments of the sweeps, where a rig moves or may have moved.

An image of another moment is taken from another place. At a steady speed all frames share that, and the camera comes
out displaced along the road, with a narrow interval.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.estimation.adjust.clock import SWEEP_S, ClockUncertainty
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.symptoms import UNTIED_CLOCKS
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_clouds

UNTIED = Check(
    topic=UNTIED_CLOCKS,
    advice=(
        "add to drive.yaml `synchronization: hardware` if one triggers the other, `motion: {speed_m_s: 0}` if the rig "
        "stood, or motion.poses at different speeds (`semcal odometry`)"
    ),
    entry=Entry(
        title="Nothing ties the images to the sweeps",
        section=PageSection.CAMERA,
        quotes=(
            (
                "nothing ties the images to the moments of the sweeps, and the rig moves 0.95 m from one frame to the "
                "next: 10 ms at 9.5 m/s are 9.5 cm, if these are 0.1 s apart: add to drive.yaml "
                "`synchronization: hardware` if one triggers the other, `motion: {speed_m_s: 0}` if the rig stood, or "
                "motion.poses at different speeds (`semcal odometry`)"
            ),
            (
                "nothing ties the images to the moments of the sweeps, and whether the rig moved cannot be seen: 10 ms "
                "at 10 m/s are 10 cm: add to drive.yaml `synchronization: hardware` if one triggers the other, "
                "`motion: {speed_m_s: 0}` if the rig stood, or motion.poses at different speeds (`semcal odometry`)"
            ),
        ),
        meaning=(
            "An image that was taken later than its sweep shows the scene from farther along the road. At a steady "
            "speed all frames are off alike: the camera comes out displaced, and no interval shows it."
        ),
        cause=(
            "The drive does not say what ties the two clocks (`synchronization:`), and its frames are not all of one "
            "scene, which would show a rig that stands."
        ),
        remedy=(
            "State what is known with [`synchronization:`](drive.md#what-ties-images-and-sweeps). If nothing is, give "
            "the motion of a drive with different speeds or turns: its frames then determine the clock, and "
            "`--estimate-delay` corrects it. Or record with the rig at rest."
        ),
        figure="Distance between neighbouring frames, from their sweeps, or the stated motion.",
    ),
)
OTHER_NAMES = Check(
    topic="other-names",
    advice="check that each sweep has the image of its name",
    entry=Entry(
        title="Images belong to sweeps of other names",
        section=PageSection.CAMERA,
        quotes=(
            (
                "sweep 0000000329.bin is paired with image 0000000330.png, and image 0000000329.png with another "
                "sweep: check that each sweep has the image of its name"
            ),
        ),
        meaning=(
            "The drive states that a trigger ties its images and sweeps, but each sweep has the image of another "
            "one's moment. At a steady speed all frames are off alike, and nothing in them shows it."
        ),
        cause="The lists of sweeps and images are shifted against each other, as where one of them lost a file.",
        remedy=(
            "Pair the files by their names, as `semcal import` does. If the names are no common numbers, give both "
            "stamps of each frame, or leave out `synchronization: hardware`."
        ),
    ),
)
ASSUMED_M_S = 10.0
"""Speed of the example where none is known, as of a car in a town."""
DELAY_S = 0.01
"""Delay of the example: one at which a camera without a trigger counts as well synchronised."""
MIN_MOVED_M = 2.0 * core.SHIFT_STEP_M
"""Smallest shift between two sweeps that shows a rig that moves."""
NUM_PAIRS = 3
"""Number of pairs of neighbouring frames whose shift is measured, at 0.03 s each."""


def check_clocks(data: LoadedDrive, clock: ClockUncertainty | None) -> Measured:
    """Check that images and sweeps are tied, by the recorder or by the frames, or that the rig stands.

    Args:
        data: The drive.
        clock: What the frames show of the clock; None if the rig stands or its motion is not stated.

    Raises:
        InputError: a sweep is missing or wrong.
    """
    drive, mispaired = data.drive, _mispaired(data.drive)
    is_hardware = drive.synchronization == "hardware"
    distance_m = None
    if _are_tied(drive, clock, is_hardware=is_hardware and mispaired is None):
        return Measured(UNTIED_CLOCKS, "", None)
    if clock is not None:
        cost = f"the rig moves: {_cost(clock.speed_m_s)}"
    elif (moved := _moved(data.recorded or drive)) is not None:
        distance_m, seconds = moved
        assumed = "" if seconds else f", if these are {SWEEP_S:g} s apart"
        speed_m_s = distance_m / (seconds or SWEEP_S)
        cost = f"the rig moves {distance_m:.2f} m from one frame to the next: {_cost(speed_m_s)}{assumed}"
    elif _stands(data.observations):
        return Measured(UNTIED_CLOCKS, "", 0.0)
    else:
        cost = f"whether the rig moved cannot be seen: {_cost(ASSUMED_M_S)}"
    if is_hardware and mispaired is not None:
        points, image, own = mispaired
        return OTHER_NAMES.without_value(
            f"sweep {points} is paired with image {image}, and image {own} with another sweep"
        )
    finding = UNTIED.finding(f"nothing ties the images to the moments of the sweeps, and {cost}")
    return Measured(UNTIED_CLOCKS, "", distance_m, finding)


def _are_tied(drive: Drive, clock: ClockUncertainty | None, *, is_hardware: bool) -> bool:
    """Whether the recorder or the frames tie the clocks, the interval includes their error, or the rig stands."""
    is_sigma_stated = "time_offset_sigma_s" in drive.model_fields_set
    if is_hardware or (is_sigma_stated and drive.time_offset_sigma_s == 0.0):
        return True
    if drive.motion is None:
        return False
    return clock is None or clock.is_checked or is_sigma_stated or drive.synchronization == "stamps"


def _cost(speed_m_s: float) -> str:
    return f"{1e3 * DELAY_S:.0f} ms at {speed_m_s:.2g} m/s are {1e2 * DELAY_S * speed_m_s:.2g} cm"


def _mispaired(drive: Drive) -> tuple[str, str, str] | None:
    """Find a sweep without stamps whose image has another name, while another frame has the image of its name.

    Returns:
        Names of the sweep, of its image, and of the image with its name; None if there is no such sweep.
    """
    names = [frame.image or frame.image_labels for frame in drive.frames]
    images = {(path.parent, path.stem): path.name for path in map(Path, filter(None, names))}
    for frame, name in zip(drive.frames, names, strict=True):
        if name is None or None not in (frame.points_stamp, frame.image_stamp):
            continue
        points, image = Path(frame.points), Path(name)
        own = images.get((image.parent, points.stem), image.name)
        if own != image.name and points.stem != image.stem:
            return points.name, image.name, own
    return None


def _stands(observations: Observations) -> bool:
    """Whether each frame shows the same scene as another one, and is no copy of it."""
    clouds, scenes = observations.of_cue(0).clouds, np.array(observations.scenes)

    def has_other(index: int) -> bool:
        others = np.flatnonzero(scenes == scenes[index])
        return any(not np.array_equal(clouds[other].points, clouds[index].points) for other in others)

    return all(map(has_other, range(len(scenes))))


def _moved(drive: Drive) -> tuple[float, float | None] | None:
    """Measure the motion between some neighbouring frames from their sweeps.

    Returns:
        The median distance where the rig moves, metres, and the time that it takes, seconds, None without stamps; None
        if no motion is seen.
    """
    neighbours = evenly_spaced([*pairwise(range(len(drive.frames)))], NUM_PAIRS)
    indices = sorted({index for pair in neighbours for index in pair})
    sweeps = dict(zip(indices, read_clouds(with_frames(drive, indices)), strict=True))
    distances_m = core.sweep_shifts(
        [(sweeps[first].points, sweeps[second].points) for first, second in neighbours]
    )
    moved = sorted(
        (distance_m, _seconds(drive.frames[first], drive.frames[second]))
        for distance_m, (first, second) in zip(distances_m, neighbours, strict=True)
        if distance_m is not None and distance_m >= MIN_MOVED_M
    )
    if not moved:
        return None
    distance_m, seconds = moved[len(moved) // 2]
    return distance_m, seconds or None


def _seconds(first: Frame, second: Frame) -> float:
    """Compute the time from one sweep to another one, seconds; 0 without stamps."""
    if first.points_stamp is None or second.points_stamp is None:
        return 0.0
    return abs(second.points_stamp - first.points_stamp)
