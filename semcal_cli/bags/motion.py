"""The motion of the LiDAR from a recording: `Odometry`, `PoseStamped` or a moving frame of `/tf`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from semcal_cli.bags.bag import Bag
from semcal_cli.bags.messages import NS, ODOMETRY, POSE, TRANSFORMS, Message, MessageError, Topic, plain_frame
from semcal_cli.bags.transforms import SAME, Edge, FrameTree, pose_of, stated_transforms
from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.geometry.poses import Pose, inverse, quaternion_xyzw

NONE = "none"
"""Value of --motion that asks for no motion."""
TF_STATIC = "/tf_static"
SCOUTED_PLACES, SCOUTED_NS = 8, NS
"""Places of the recording, and time from each, at which `/tf` is read to learn which of its frames move."""
LONGEST_GAP_NS = NS // 2
"""Longest time between two poses that a frame may lie between."""
LONGEST_SWEEP_NS, LONGEST_LATENCY_NS = NS // 5, NS
"""Time before the stamp that the points of a sweep may begin, and time that poses may take to be received."""


class MovingFrame(NamedTuple):
    """A frame that moves in another one, by a topic of transforms."""

    topic: Topic
    """The topic."""
    parent: str
    """The frame that it moves in."""
    child: str
    """The frame that moves."""


class MotionSource(NamedTuple):
    """A topic that tells where the LiDAR is."""

    topic: Topic
    """The topic."""
    frame: str
    """Frame whose poses it holds."""
    parent: str | None
    """Frame in which they are; None if any is taken."""
    T_frame_lidar: Pose
    """(4, 4) fixed transform of the LiDAR in it, metres."""


class Trajectory:
    """Poses of the LiDAR in a fixed frame, by their stamps."""

    def __init__(self, source: MotionSource) -> None:
        self.source = source
        self._poses: dict[int, Pose] = {}
        self._sorted: list[int] | None = []
        self._latency_ns = 0

    @property
    def before_ns(self) -> int:
        """What has to be read before the stamp of a sweep, so that there is a pose before its first point."""
        return LONGEST_GAP_NS + LONGEST_SWEEP_NS

    @property
    def after_ns(self) -> int:
        """What has to be read after the receipt of a sweep, so that there is a pose after its last point."""
        return LONGEST_GAP_NS + self._latency_ns

    def take(self, message: Message, received: bool) -> None:
        """Add the poses of a message, with the stamps of headers, or with the time at which it was received."""
        try:
            found = _poses(message, self.source)
        except MessageError:
            return
        for stamp, T in found:
            if not received:
                self._latency_ns = max(self._latency_ns, min(message.received_ns - stamp, LONGEST_LATENCY_NS))
            self._poses[message.received_ns if received else stamp] = T @ self.source.T_frame_lidar
            self._sorted = None

    def covers(self, *stamps_ns: int) -> bool:
        """Whether poses stand closely before and after each of the stamps."""
        stamps = self._stamps()
        places = [bisect_left(stamps, stamp) for stamp in stamps_ns]
        return all(
            0 < place < len(stamps) and stamps[place] - stamps[place - 1] <= LONGEST_GAP_NS
            for place in places
        )

    def position(self, stamp_ns: int) -> np.ndarray | None:
        """Position (3,) of the pose that is nearest in time, metres; None without poses."""
        stamps = self._stamps()
        if not stamps:
            return None
        place = min(bisect_left(stamps, stamp_ns), len(stamps) - 1)
        nearest = min(stamps[max(place - 1, 0) : place + 1], key=lambda stamp: abs(stamp - stamp_ns))
        position: np.ndarray = self._poses[nearest][:3, 3]
        return position

    def tum(self) -> str:
        """Write the poses, one line each: seconds x y z qx qy qz qw (TUM)."""
        lines = []
        for stamp in self._stamps():
            T = self._poses[stamp]
            numbers = [*T[:3, 3], *quaternion_xyzw(T)]
            lines.append(" ".join([seconds_text(stamp), *(f"{each:.12g}" for each in numbers)]))
        return "\n".join(lines) + "\n"

    def _stamps(self) -> list[int]:
        """Stamps of the poses, ascending; sorted once, since they are asked for again and again after the last pose."""
        if self._sorted is None:
            self._sorted = sorted(self._poses)
        return self._sorted


def read_frames(bag: Bag) -> tuple[FrameTree, list[MovingFrame]]:
    """Read the fixed transforms of a recording, and what moves by its topics of transforms.

    Transforms of `/tf` that stay the same at every place that is read are fixed, too: ROS 1 has no other way.
    """
    tree, moving = FrameTree(), []
    topics = bag.of_types(TRANSFORMS)
    for message in bag.messages([topic for topic in topics if topic.name == TF_STATIC]):
        with suppress(MessageError):
            tree.add(stated_transforms(message.content.transforms))
    for topic in topics:
        if topic.name != TF_STATIC:
            stated = _scouted(bag, topic)
            for (parent, child), poses in stated.items():
                if any(np.abs(T - poses[0]).max() > SAME for T in poses):
                    moving.append(MovingFrame(topic, parent, child))
                elif (parent, child) not in tree.edges:
                    tree.add([((parent, child), poses[0])])
    return tree, moving


def _scouted(bag: Bag, topic: Topic) -> dict[Edge, list[Pose]]:
    """Read the transforms of a topic at a few places of the recording."""
    starts = np.linspace(topic.span.first_ns, topic.span.last_ns, SCOUTED_PLACES)
    places = (
        [(int(start), int(start) + SCOUTED_NS) for start in starts]
        if bag.is_indexed
        else [(0, bag.end_ns + 1)]
    )
    found: dict[Edge, list[Pose]] = {}
    for start, stop in places:
        for message in bag.messages([topic], start, stop):
            with suppress(MessageError):
                for edge, T in stated_transforms(message.content.transforms):
                    found.setdefault(edge, []).append(T)
    return found


def find_motion(
    bag: Bag,
    tree: FrameTree,
    moving: Sequence[MovingFrame],
    lidar: str,
    wanted: str | None,
    frame: str | None,
) -> tuple[MotionSource | None, str | None]:
    """Find the topic that tells how the LiDAR moves.

    Args:
        bag: The recording.
        tree: Its fixed transforms.
        moving: Its frames that move by topics of transforms.
        lidar: Frame of the sweeps.
        wanted: Name of the topic, or `none`; None for the only one.
        frame: Frame whose poses the topic holds; None for the one that its messages name.

    Returns:
        The source, if there is one, and a sentence that says why there is none although there are poses.

    Raises:
        InputError: the topic that is wanted is missing, or does not fit.
    """
    if wanted == NONE:
        return None, None
    fixed = tree.reached(lidar)
    if wanted is not None:
        return _wanted(bag, moving, fixed, wanted, frame), None
    candidates = [*bag.of_types([ODOMETRY]), *bag.of_types([POSE] if frame else [])]
    usable = [source for topic in candidates if (source := _source(bag, topic, fixed, frame)) is not None]
    usable = usable or _carrying(moving, fixed)
    if len(usable) == 1:
        return usable[0], None
    if usable:
        names = listed(f"{source.topic.name} of {source.frame} in {source.parent}" for source in usable)
        return None, f"several topics tell of motion, {names}: choose one by --motion"
    others = [
        *(topic.name for topic in bag.of_types([ODOMETRY, POSE])),
        *(each.topic.name for each in moving),
    ]
    if not others:
        return None, None
    reason = (
        f"no motion: {listed(dict.fromkeys(others))} tell of frames that no fixed transform ties to {lidar!r}"
    )
    return None, f"{reason}; see --motion and --motion-frame"


def _wanted(
    bag: Bag, moving: Sequence[MovingFrame], fixed: dict[str, Pose], wanted: str, frame: str | None
) -> MotionSource:
    known = [topic for topic in bag.of_types([ODOMETRY, POSE, *TRANSFORMS]) if topic.name != TF_STATIC]
    topic = next((topic for topic in known if topic.name == wanted), None)
    if topic is None:
        names = listed([*(topic.name for topic in known), NONE])
        raise InputError(f"--motion: found no topic {wanted!r} of poses, needed one of: {names}")
    if topic.type in TRANSFORMS:
        sources = _carrying([each for each in moving if each.topic == topic], fixed)
        sources = [source for source in sources if frame in (None, source.frame)]
        if len(sources) == 1:
            return sources[0]
        found = listed(f"{source.frame} in {source.parent}" for source in sources)
        raise InputError(
            f"--motion {wanted}: found the moving frames {found}, needed one that the LiDAR is fixed to"
        )
    if topic.type == POSE and frame is None:
        needed = "needed --motion-frame FRAME: a PoseStamped does not say whose pose it is"
        raise InputError(f"--motion {wanted}: {needed}")
    source = _source(bag, topic, fixed, frame)
    if source is None:
        stated = frame or _child(bag, topic) or "nothing"
        needed = f"needed one that the LiDAR is fixed to: {listed(fixed)}; see --motion-frame"
        raise InputError(f"--motion {wanted}: found poses of {stated!r}, {needed}")
    return source


def _carrying(moving: Sequence[MovingFrame], fixed: dict[str, Pose]) -> list[MotionSource]:
    """List the moving frames that carry the LiDAR in a frame that does not."""
    return [
        MotionSource(each.topic, each.child, each.parent, inverse(fixed[each.child]))
        for each in moving
        if each.child in fixed and each.parent not in fixed
    ]


def _source(bag: Bag, topic: Topic, fixed: dict[str, Pose], frame: str | None) -> MotionSource | None:
    """Make a source of a topic of poses, if the LiDAR is fixed to the frame whose poses it holds."""
    child = frame or _child(bag, topic)
    if child is None or child not in fixed:
        return None
    return MotionSource(topic, child, _parent(bag, topic), inverse(fixed[child]))


def _child(bag: Bag, topic: Topic) -> str | None:
    """Read whose poses an Odometry holds."""
    first = bag.first(topic)
    try:
        child = (
            plain_frame(first.content.child_frame_id) if first is not None and topic.type == ODOMETRY else ""
        )
    except MessageError:
        return None
    return child or None


def _parent(bag: Bag, topic: Topic) -> str | None:
    """Read in which frame an Odometry or a PoseStamped states its poses."""
    first = bag.first(topic)
    try:
        return None if first is None else first.frame_id
    except MessageError:
        return None


def _poses(message: Message, source: MotionSource) -> list[tuple[int, Pose]]:
    """Read stamps and poses of a source from a message; those of other frames do not count."""
    content = message.content
    if message.type in TRANSFORMS:
        return [
            (each.header.stamp.sec * NS + each.header.stamp.nanosec, T)
            for each in content.transforms
            for (parent, child), T in stated_transforms([each])
            if (parent, child) == (source.parent, source.frame)
        ]
    if message.frame_id != source.parent:
        return []
    if message.type == ODOMETRY and plain_frame(content.child_frame_id) not in ("", source.frame):
        return []
    pose = content.pose.pose if message.type == ODOMETRY else content.pose
    T = pose_of(pose.orientation, pose.position)
    return [] if T is None else [(message.header_ns, T)]


def seconds_text(stamp_ns: int) -> str:
    """Write a time in seconds, with all nine digits of its nanoseconds."""
    sign, stamp = ("-" if stamp_ns < 0 else ""), abs(stamp_ns)
    return f"{sign}{stamp // NS}.{stamp % NS:09d}"
