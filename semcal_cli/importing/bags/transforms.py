"""Coordinate frames of a recording: chains of fixed transforms from `/tf_static` and `/tf`."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from semcal_cli.config.directions import CameraFrame
from semcal_cli.config.file_limits import MAX_TRANSFORMS
from semcal_cli.errors import InputError, listed
from semcal_cli.formats.frame_names import OPTICAL_WORDS, T_BODY_OPTICAL, has_word
from semcal_cli.formats.node import MAX_WORLD_M, rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, pose_from_quaternion
from semcal_cli.importing.bags.messages import plain_frame
from semcal_cli.importing.body_frames import body_frame_doubts

TF_STATIC = "/tf_static"
Edge = tuple[str, str]
"""Parent and child."""
CONTRADICTION = 1e-4
"""Difference between two chains that rounding does not explain, metres or entries of a rotation."""
SAME = 1e-9
"""Largest difference between two transforms that are the same."""


class FrameTree:
    """Coordinate frames and the fixed transforms between them."""

    def __init__(self) -> None:
        self.edges: dict[Edge, Pose] = {}
        """T_parent_child (4, 4) by parent and child, metres."""
        self.changed: set[Edge] = set()
        """Edges that were stated again with another transform; the last one is used."""
        self.contradictory: set[str] = set()
        """Frames to which several chains lead that contradict one another; `reached` adds those that it finds."""

    def add(self, edge: Edge, T: Pose) -> None:
        """Add T_parent_child (4, 4) of a parent and a child."""
        if np.abs(self.edges.get(edge, T) - T).max() > SAME:
            self.changed.add(edge)
        self.edges[edge] = T

    def transforms_from(self, frame: str) -> dict[str, Pose]:
        """Find every frame that is fixed to a frame, including itself, with T_frame_other (4, 4)."""
        neighbours: dict[str, list[tuple[str, Pose]]] = {}
        for (parent, child), T in self.edges.items():
            neighbours.setdefault(parent, []).append((child, T))
            neighbours.setdefault(child, []).append((parent, inverse(T)))
        transforms, queue = {frame: np.eye(4)}, deque([frame])
        while queue:
            current = queue.popleft()
            for neighbour, T in neighbours.get(current, []):
                T_frame_other = transforms[current] @ T
                if neighbour not in transforms:
                    transforms[neighbour] = T_frame_other
                    queue.append(neighbour)
                elif np.abs(transforms[neighbour] - T_frame_other).max() > CONTRADICTION:
                    self.contradictory |= {current, neighbour}
        return transforms

    def describe_gap(self, source: str, target: str) -> str:
        """Describe why there is no chain between two frames."""
        if not self.edges:
            return "there are no fixed transforms"
        from_source, from_target = (listed(sorted(self.transforms_from(frame))) for frame in (source, target))
        return f"no chain of fixed transforms connects {from_source} with {from_target}"


def reference(
    tree: FrameTree,
    lidar: str,
    camera: str,
    rectification: Mapping[str, Any] | None,
    axes: CameraFrame | None = None,
) -> tuple[Pose | None, list[str]]:
    """Find T_camera_lidar (4, 4), metres, in the fixed transforms.

    Args:
        tree: The fixed transforms.
        lidar: Frame of the sweeps.
        camera: Frame of the images.
        rectification: R (9) and P (12), by rows, of the camera whose images are rectified; None if they are raw.
        axes: Axes of the camera's frame; None for optical ones, with a remark if they seem to be others.

    Returns:
        The transform, if there is one, and sentences about it.

    Raises:
        InputError: R is not a rotation.
    """
    remarks = []
    if tree.changed:
        edges = listed(f"{parent} to {child}" for parent, child in sorted(tree.changed))
        remarks.append(f"{TF_STATIC} states several transforms of {edges}: the last one is used")
    T = tree.transforms_from(camera).get(lidar)
    if lidar == camera:
        why_not = f": sweeps and images both have the frame {lidar!r}"
    elif T is not None and tree.contradictory:
        why_not = f": fixed transforms contradict one another at {listed(sorted(tree.contradictory))}"
    elif T is None or not lidar:
        why_not = f" from {lidar!r} to {camera!r}: {tree.describe_gap(lidar, camera)}"
    elif rectification is not None and (rectification["P"][3] or rectification["P"][7]):
        why_not = ": P belongs to the second camera of a stereo pair, whose frame is not stated"
    else:
        if axes == "body":
            T = inverse(T_BODY_OPTICAL) @ T
        elif axes is None:
            remarks += _doubts(camera, T)
        if rectification is not None and any(rectification["R"]):
            T[:3] = np.reshape(rectification["R"], (3, 3)) @ T[:3]
            T = rigid(f"{camera}: R of the camera in this frame", T)
        return T, [
            *remarks,
            f"the reference T_camera_lidar comes from the recording, from {lidar!r} to {camera!r}",
        ]
    return None, [*remarks, f"no reference{why_not}"]


def optical_frame(
    tree: FrameTree,
    lidar: str,
    camera: str,
    rectification: Mapping[str, Any] | None,
    axes: CameraFrame | None = None,
) -> str | None:
    """Return the name of the camera's frame if its axes are those of the images; see `reference` for the arguments.

    None for a body frame, also a probable one, and for images that are rectified to other axes or for another camera.
    """
    T = tree.transforms_from(camera).get(lidar)
    is_body = axes == "body" or (axes is None and T is not None and bool(_doubts(camera, T)))
    if is_body or rectification is None:
        return None if is_body else camera
    R, P = np.reshape(rectification["R"], (3, 3)), rectification["P"]
    is_turned = R.any() and np.abs(R - np.eye(3)).max() > CONTRADICTION
    return None if is_turned or P[3] or P[7] else camera


def _doubts(camera: str, T_camera_lidar: Pose) -> list[str]:
    """Describe why a camera's frame may be a body frame, unless it is called optical."""
    is_optical = has_word(camera, OPTICAL_WORDS)
    return [] if is_optical else body_frame_doubts(repr(camera), T_camera_lidar, "--frame")


def check_count(num_edges: int, topic: str) -> None:
    """Check the number of pairs of frames with a transform in a topic.

    Raises:
        InputError: there are too many.
    """
    if num_edges > MAX_TRANSFORMS:
        raise InputError(f"{topic}: found more than {MAX_TRANSFORMS:,} pairs of frames, needed fewer")


def read_transforms(transforms: Iterable[Any]) -> list[tuple[Edge, Pose]]:
    """Read TransformStamped messages: T_parent_child (4, 4) by parent and child, without those that are not rigid."""
    poses = []
    for message in transforms:
        T = pose_of(message.transform.rotation, message.transform.translation)
        edge = plain_frame(message.header.frame_id), plain_frame(message.child_frame_id)
        if T is not None and edge[0] != edge[1]:
            poses.append((edge, T))
    return poses


def pose_of(rotation: Any, position: Any) -> Pose | None:
    """Make a transform (4, 4), metres, of a Quaternion and a Point or Vector3; None if it is not rigid."""
    quaternion = [rotation.x, rotation.y, rotation.z, rotation.w]
    translation = [position.x, position.y, position.z]
    try:
        return rigid("transform", pose_from_quaternion(quaternion, translation), MAX_WORLD_M)
    except (ValueError, InputError):
        return None
