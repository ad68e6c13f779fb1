"""The motion of the LiDAR from a recording: `Odometry`, `PoseStamped` or a moving frame of `/tf`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError, listed
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.messages import (
    ODOMETRY,
    POSE,
    TRANSFORMS,
    Message,
    MessageError,
    Topic,
    plain_frame,
)
from semcal_cli.importing.bags.transforms import (
    SAME,
    TF_STATIC,
    Edge,
    FrameTree,
    check_count,
    pose_of,
    read_transforms,
)
from semcal_cli.importing.stamps import MAX_GAP_NS, are_covered, tum_text
from semcal_cli.importing.sweep_odometry import odometry_remark

NO_MOTION = "none"
"""Value of --motion that asks for no motion."""
SCOUTED_PLACES, SCOUTED_NS = 8, NS
"""Places of the recording, and time from each, at which `/tf` is read to learn which of its frames move."""
LONGEST_SWEEP_NS, LONGEST_LATENCY_NS = NS // 5, NS
"""How long before its stamp a sweep's first point may be, and how late poses may be received."""


class MotionSource(NamedTuple):
    """A frame whose poses a topic states."""

    topic: Topic
    """The topic."""
    frame: str
    """The frame that moves."""
    parent: str | None
    """The frame that it moves in; None if unknown."""


class Trajectory:
    """Poses of the LiDAR in a fixed frame, by their stamps."""

    def __init__(self, source: MotionSource | None, T_frame_lidar: Pose) -> None:
        """Start without poses; T_frame_lidar (4, 4), metres, is the fixed pose of the LiDAR in the moving frame."""
        self.source = source
        """The topic that states the poses; None if they are estimated from the sweeps."""
        self._T_frame_lidar = T_frame_lidar
        self._poses: dict[int, Pose] = {}
        self._stamps: list[int] = []
        self._is_sorted = True
        self._latency_ns = 0

    @classmethod
    def from_poses(cls, poses: Mapping[int, Pose]) -> Trajectory:
        """Take poses (4, 4) of the LiDAR by their stamps in nanoseconds, ascending, as estimated from the sweeps."""
        trajectory = cls(None, np.eye(4))
        trajectory._poses, trajectory._stamps = dict(poses), list(poses)
        return trajectory

    @property
    def description(self) -> str:
        """Sentence about the source of the motion."""
        if self.source is None:
            return odometry_remark()
        return f"{self.source.topic.name} states the motion of {self.source.frame!r}"

    @property
    def before_ns(self) -> int:
        """How much to read before the stamp of a sweep, so that there is a pose before its first point."""
        return MAX_GAP_NS + LONGEST_SWEEP_NS

    @property
    def after_ns(self) -> int:
        """How much to read after the receipt of a sweep, so that there is a pose after its last point."""
        return MAX_GAP_NS + self._latency_ns

    def take(self, message: Message, received: bool) -> None:
        """Add the poses of a message, with the stamps of headers or, if `received`, with the time of receipt."""
        assert self.source is not None
        try:
            poses = _poses(message, self.source)
        except MessageError:
            return
        for stamp, T in poses:
            if not received:
                self._latency_ns = max(self._latency_ns, min(message.received_ns - stamp, LONGEST_LATENCY_NS))
            time = message.received_ns if received else stamp
            if time not in self._poses:
                self._is_sorted &= not self._stamps or time > self._stamps[-1]
                self._stamps.append(time)
            self._poses[time] = T @ self._T_frame_lidar

    @property
    def poses(self) -> dict[int, Pose]:
        """Poses (4, 4) of the LiDAR by their stamps in nanoseconds, ascending."""
        return {stamp: self._poses[stamp] for stamp in self._ordered()}

    def covers(self, *stamps_ns: int) -> bool:
        """Return whether poses lie close before and after each of the stamps."""
        return are_covered(self._ordered(), stamps_ns)

    def position(self, stamp_ns: int) -> np.ndarray | None:
        """Return the position (3,) of the pose that is nearest in time, metres; None without poses."""
        if not self._stamps:
            return None
        stamps = self._ordered()
        index = bisect_left(stamps, stamp_ns)
        neighbours = stamps[max(index - 1, 0) : index + 1]
        nearest = min(neighbours, key=lambda stamp: abs(stamp - stamp_ns))
        position: np.ndarray = self._poses[nearest][:3, 3]
        return position

    def _ordered(self) -> list[int]:
        """Sort the stamps if some came late: to insert each in its place would take the square of their number."""
        if not self._is_sorted:
            self._stamps.sort()
            self._is_sorted = True
        return self._stamps

    def tum(self) -> str:
        """Format the poses, one per line (see `tum_text`); estimated ones follow a comment that says so."""
        note = "" if self.source is not None else f"# {self.description}\n"
        return note + tum_text(self.poses)


def read_frames(bag: Bag) -> tuple[FrameTree, list[MotionSource]]:
    """Read the fixed transforms of a recording, and the frames that its topics of transforms move.

    Transforms of `/tf` that are the same at every place that is read are fixed, too: ROS 1 often publishes them there.
    """
    tree, moving = FrameTree(), []
    topics = bag.of_types(TRANSFORMS)
    for edge, T in _read_transforms(bag, [topic for topic in topics if topic.name == TF_STATIC]):
        tree.add(edge, T)
        check_count(len(tree.edges), TF_STATIC)
    for topic in topics:
        if topic.name == TF_STATIC:
            continue
        first, moved = dict[Edge, Pose](), set[Edge]()
        for start_ns, stop_ns in _places(bag, topic):
            for edge, T in _read_transforms(bag, [topic], start_ns, stop_ns):
                if np.abs(T - first.setdefault(edge, T)).max() > SAME:
                    moved.add(edge)
                check_count(len(first), topic.name)
        for edge, T in first.items():
            if edge in moved:
                moving.append(MotionSource(topic, edge[1], edge[0]))
            elif edge not in tree.edges:
                tree.add(edge, T)
    return tree, moving


def _read_transforms(
    bag: Bag, topics: Sequence[Topic], start_ns: int | None = None, stop_ns: int | None = None
) -> Iterator[tuple[Edge, Pose]]:
    for message in bag.messages(topics, start_ns, stop_ns):
        with suppress(MessageError):
            yield from read_transforms(message.content.transforms)


def _places(bag: Bag, topic: Topic) -> list[tuple[int, int]]:
    """List the stretches in which transforms are read to learn which of them change."""
    if not bag.is_indexed:
        return [(bag.start_ns, bag.end_ns + 1)]
    starts_ns = map(int, np.linspace(topic.span.first_ns, topic.span.last_ns, SCOUTED_PLACES))
    return [(start_ns, start_ns + SCOUTED_NS) for start_ns in starts_ns]


def find_motion(
    bag: Bag,
    tree: FrameTree,
    moving: Sequence[MotionSource],
    lidar: str,
    topic_name: str | None,
    frame: str | None,
) -> tuple[Trajectory | None, str | None]:
    """Find the topic that states the motion of the LiDAR.

    Args:
        bag: The recording.
        tree: Its fixed transforms.
        moving: Its frames that topics of transforms move.
        lidar: Frame of the sweeps.
        topic_name: Name of the topic, or `none`; None for the only one.
        frame: Frame whose poses the topic holds; None for the one that its messages name.

    Returns:
        The trajectory, still without poses, or None; and a sentence that says why there is none although there are
        topics of poses.

    Raises:
        InputError: the wanted topic is missing or does not fit.
    """
    if topic_name == NO_MOTION:
        return None, None
    fixed = tree.transforms_from(lidar)
    carriers = [source for source in moving if source.frame in fixed and source.parent not in fixed]
    pose_sources = _pose_sources(bag, topic_name, frame)
    if topic_name is not None:
        carriers = [
            source for source in carriers if source.topic.name == topic_name and frame in (None, source.frame)
        ]
    sources = [source for source in pose_sources if source.frame and source.frame in fixed] or carriers
    if len(sources) == 1:
        return Trajectory(sources[0], inverse(fixed[sources[0].frame])), None
    if topic_name is not None:
        raise _misfit(bag, topic_name, pose_sources, carriers, fixed)
    if sources:
        names = listed(f"{source.topic.name} of {source.frame} in {source.parent}" for source in sources)
        return None, f"several topics state a motion, {names}: choose one with --motion"
    others = dict.fromkeys(source.topic.name for source in (*pose_sources, *moving))
    if not others:
        return None, None
    reason = f"no motion: no fixed transform connects the frames of {listed(others)} to {lidar!r}"
    return None, f"{reason}; see --motion and --motion-frame"


def _misfit(
    bag: Bag,
    topic_name: str,
    pose_sources: Sequence[MotionSource],
    carriers: Sequence[MotionSource],
    fixed: Iterable[str],
) -> InputError:
    """Explain why the wanted topic states no motion of the LiDAR."""
    topics = [topic for topic in bag.of_types([ODOMETRY, POSE, *TRANSFORMS]) if topic.name != TF_STATIC]
    if topic_name not in [topic.name for topic in topics]:
        names = listed([*(topic.name for topic in topics), NO_MOTION])
        return InputError(f"--motion: found no topic {topic_name!r} of poses, expected one of: {names}")
    if not pose_sources:
        frames = listed(f"{source.frame} in {source.parent}" for source in carriers)
        return InputError(
            f"--motion {topic_name}: found the moving frames {frames}, expected one that the LiDAR is fixed to"
        )
    if pose_sources[0].topic.is_a([POSE]) and not pose_sources[0].frame:
        needed = "add --motion-frame FRAME: a PoseStamped does not say whose pose it is"
        return InputError(f"--motion {topic_name}: {needed}")
    needed = f"expected those of a frame that the LiDAR is fixed to: {listed(fixed)}; see --motion-frame"
    return InputError(
        f"--motion {topic_name}: found poses of {pose_sources[0].frame or 'nothing'!r}, {needed}"
    )


def _pose_sources(bag: Bag, topic_name: str | None, frame: str | None) -> list[MotionSource]:
    """List the topics of poses, or only the wanted one; the frame is empty if its messages do not name one."""
    sources = []
    for topic in bag.of_types([ODOMETRY, POSE]):
        if topic_name in (None, topic.name):
            child, parent, first = "", None, bag.first(topic)
            if first is not None:
                with suppress(MessageError):
                    child = plain_frame(first.content.child_frame_id) if topic.is_a([ODOMETRY]) else ""
                    parent = first.frame_id
            sources.append(MotionSource(topic, frame or child, parent))
    return sources


def _poses(message: Message, source: MotionSource) -> list[tuple[int, Pose]]:
    """Read the stamps and poses of a source from a message, without those of other frames."""
    content = message.content
    if message.is_a(*TRANSFORMS):
        return [
            (transform.header.stamp.sec * NS + transform.header.stamp.nanosec, T)
            for transform in content.transforms
            for (parent, child), T in read_transforms([transform])
            if (parent, child) == (source.parent, source.frame)
        ]
    if message.frame_id != source.parent:
        return []
    if message.is_a(ODOMETRY) and plain_frame(content.child_frame_id) not in ("", source.frame):
        return []
    pose = content.pose.pose if message.is_a(ODOMETRY) else content.pose
    T = pose_of(pose.orientation, pose.position)
    return [] if T is None else [(message.header_ns, T)]
