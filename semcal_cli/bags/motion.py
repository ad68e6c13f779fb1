"""The motion of the LiDAR from a recording: `Odometry`, `PoseStamped` or a moving frame of `/tf`."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

import numpy as np

from semcal_cli.bags.bag import Bag, Topic
from semcal_cli.bags.messages import NS, ODOMETRY, POSE, TRANSFORMS, Message, MessageError, plain_frame
from semcal_cli.bags.transforms import FrameTree, pose_of, stated_transforms
from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.geometry.poses import Pose, inverse, quaternion_xyzw

NONE = "none"
"""Value of --motion that asks for no motion."""
TF_STATIC = "/tf_static"
SCOUTED = 200
"""Messages of a topic of transforms that are read to learn its frames."""
LONGEST_GAP_NS = NS // 2
"""Longest time between two poses that a frame may lie between."""


class MotionSource(NamedTuple):
    """A topic that tells where the LiDAR is."""

    topic: Topic
    """The topic."""
    frame: str
    """Frame whose poses it holds."""
    T_frame_lidar: Pose
    """(4, 4) fixed transform of the LiDAR in it, metres."""


class Trajectory:
    """Poses of the LiDAR in a fixed frame, by their stamps."""

    def __init__(self, source: MotionSource) -> None:
        self.source = source
        self._poses: dict[int, Pose] = {}

    def take(self, message: Message, received: bool) -> None:
        """Add the poses of a message, with the stamps of headers, or with the time at which it was received."""
        try:
            found = _poses(message, self.source.frame)
        except MessageError:
            return
        for stamp, T in found:
            self._poses[message.received_ns if received else stamp] = T @ self.source.T_frame_lidar

    def covers(self, *stamps_ns: int) -> bool:
        """Whether poses stand closely before and after each of the stamps."""
        stamps = sorted(self._poses)
        places = [(stamp, bisect_left(stamps, stamp)) for stamp in stamps_ns]
        return all(
            0 < place < len(stamps) and stamps[place] - stamps[place - 1] <= LONGEST_GAP_NS
            for _, place in places
        )

    def position(self, stamp_ns: int) -> np.ndarray | None:
        """Position (3,) of the pose that is nearest in time, metres; None without poses."""
        stamps = sorted(self._poses)
        if not stamps:
            return None
        place = min(bisect_left(stamps, stamp_ns), len(stamps) - 1)
        nearest = min(stamps[max(place - 1, 0) : place + 1], key=lambda stamp: abs(stamp - stamp_ns))
        position: np.ndarray = self._poses[nearest][:3, 3]
        return position

    def tum(self) -> str:
        """Write the poses, one line each: seconds x y z qx qy qz qw (TUM)."""
        lines = []
        for stamp, T in sorted(self._poses.items()):
            numbers = [*T[:3, 3], *quaternion_xyzw(T)]
            lines.append(" ".join([seconds_text(stamp), *(f"{each:.12g}" for each in numbers)]))
        return "\n".join(lines) + "\n"

    def __len__(self) -> int:
        return len(self._poses)


def find_motion(
    bag: Bag, tree: FrameTree, lidar: str, wanted: str | None, frame: str | None
) -> tuple[MotionSource | None, str | None]:
    """Find the topic that tells how the LiDAR moves.

    Args:
        bag: The recording.
        tree: Its fixed transforms.
        lidar: Frame of the sweeps.
        wanted: Name of the topic, or `none`; None for the only one.
        frame: Frame whose poses the topic holds; None for the one that its messages name.

    Returns:
        The source, if there is one, and a sentence that says why there is none or which were left out.

    Raises:
        InputError: the topic that is wanted is missing, or does not fit.
    """
    if wanted == NONE:
        return None, None
    fixed = tree.reached(lidar)
    if wanted is not None:
        return _wanted(bag, fixed, wanted, frame), None
    candidates = [*bag.of_types([ODOMETRY]), *bag.of_types([POSE] if frame else [])]
    usable = [source for topic in candidates if (source := _source(bag, topic, fixed, frame)) is not None]
    if not usable:
        usable = _moving_frames(bag, fixed)
    if len(usable) == 1:
        return usable[0], None
    names = listed(f"{source.topic.name} of {source.frame}" for source in usable)
    return None, f"several topics tell of motion, {names}: choose one by --motion" if usable else None


def _wanted(bag: Bag, fixed: dict[str, Pose], wanted: str, frame: str | None) -> MotionSource:
    known = bag.of_types([ODOMETRY, POSE, *TRANSFORMS])
    topic = next((topic for topic in known if topic.name == wanted), None)
    if topic is None:
        names = listed(topic.name for topic in known if topic.name != TF_STATIC)
        raise InputError(f"--motion: found no topic {wanted!r} of poses, needed one of: {names}; or {NONE}")
    if topic.type in TRANSFORMS:
        moving = [source for source in _moving_frames(bag, fixed) if frame in (None, source.frame)]
        if len(moving) == 1:
            return moving[0]
        found = listed(source.frame for source in moving)
        raise InputError(
            f"--motion {wanted}: found the moving frames {found}, needed one that the LiDAR is fixed to"
        )
    if topic.type == POSE and frame is None:
        needed = "needed --motion-frame FRAME: a PoseStamped does not say whose pose it is"
        raise InputError(f"--motion {wanted}: {needed}")
    source = _source(bag, topic, fixed, frame)
    if source is None:
        stated = frame or _child(bag, topic) or "nothing"
        needed = f"needed one that the LiDAR is fixed to by {TF_STATIC}: {listed(fixed)}; see --motion-frame"
        raise InputError(f"--motion {wanted}: found poses of {stated!r}, {needed}")
    return source


def _source(bag: Bag, topic: Topic, fixed: dict[str, Pose], frame: str | None) -> MotionSource | None:
    """Make a source of a topic of poses, if the LiDAR is fixed to the frame whose poses it holds."""
    child = frame or _child(bag, topic)
    if child is None or child not in fixed:
        return None
    return MotionSource(topic, child, inverse(fixed[child]))


def _child(bag: Bag, topic: Topic) -> str | None:
    """Read whose poses an Odometry holds."""
    first = next(bag.messages([topic]), None)
    try:
        return (
            plain_frame(first.content.child_frame_id)
            if first is not None and topic.type == ODOMETRY
            else None
        )
    except MessageError:
        return None


def _moving_frames(bag: Bag, fixed: dict[str, Pose]) -> list[MotionSource]:
    """List the moving edges of `/tf` whose child carries the LiDAR and whose parent does not."""
    topics = [topic for topic in bag.of_types(TRANSFORMS) if topic.name != TF_STATIC]
    found: dict[str, MotionSource] = {}
    for topic in topics:
        for _, message in zip(range(SCOUTED), bag.messages([topic]), strict=False):
            try:
                edges = stated_transforms(message.content.transforms)
            except MessageError:
                continue
            for (parent, child), _ in edges:
                if child in fixed and parent not in fixed:
                    found[child] = MotionSource(topic, child, inverse(fixed[child]))
    return list(found.values())


def _poses(message: Message, frame: str) -> list[tuple[int, Pose]]:
    """Read stamps and poses of a frame from a message."""
    content = message.content
    if message.type in TRANSFORMS:
        return [
            (each.header.stamp.sec * NS + each.header.stamp.nanosec, T)
            for each in content.transforms
            if plain_frame(each.child_frame_id) == frame
            for _, T in stated_transforms([each])
        ]
    pose = content.pose.pose if message.type == ODOMETRY else content.pose
    T = pose_of(pose.orientation, pose.position)
    return [] if T is None else [(message.header_ns, T)]


def seconds_text(stamp_ns: int) -> str:
    """Write a time in seconds, with all nine digits of its nanoseconds."""
    sign, stamp = ("-" if stamp_ns < 0 else ""), abs(stamp_ns)
    return f"{sign}{stamp // NS}.{stamp % NS:09d}"
