"""The camera of a recording: the `camera:` block of its drive, from the user's file or from a topic."""

from __future__ import annotations

from typing import Any, NamedTuple

from semcal_cli.errors import InputError
from semcal_cli.formats.camera_block import read_intrinsics, resized
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.camera_messages import CameraInfo, camera_block, check_same, read_camera_info
from semcal_cli.importing.bags.image_messages import image_file
from semcal_cli.importing.bags.messages import VIDEOS, MessageError, Topic
from semcal_cli.importing.bags.topics import BagRequest, Topics

MAX_LATCHED = 100
"""Largest number of messages of a camera that is published now and then, rather than with each image."""


class RecordedCamera(NamedTuple):
    """The camera of a recording."""

    block: dict[str, Any]
    """The `camera:` block of the drive."""
    info: CameraInfo | None = None
    """The message that it was read from; None for the user's file."""
    remarks: tuple[str, ...] = ()
    """Sentences about it that the user should read."""


def recorded_camera(bag: Bag, request: BagRequest, topics: Topics) -> RecordedCamera:
    """Read the camera, converted to the size of the first image if the user says that images were resized.

    Raises:
        InputError: the intrinsics are missing or wrong, change during the recording, or do not fit resized images.
    """
    if request.intrinsics is not None:
        camera = RecordedCamera(read_intrinsics(request.intrinsics))
    else:
        assert topics.camera_info is not None
        camera = _camera_of_topic(bag, topics, topics.camera_info)
    if not request.is_resized:
        return camera
    return camera._replace(block=_resized_block(bag, topics.image, camera.block))


def _camera_of_topic(bag: Bag, topics: Topics, topic: Topic) -> RecordedCamera:
    """Read the camera from the first message of its topic."""
    first, image, remarks = bag.first(topic), topics.image, []
    if first is None:
        raise bag.refusal(
            f"{topic.name}: found no whole message, expected the intrinsics, or --intrinsics FILE"
        )
    try:
        info = read_camera_info(first)
    except MessageError as error:
        raise InputError(f"{topic.name}: {error}") from None
    if not topics.is_beside:
        remarks.append(f"{topic.name} is not next to {image.name}; its intrinsics are used anyway")
    if topic.span.num_messages <= MAX_LATCHED:
        for message in bag.messages([topic]):
            check_same(message, info, bag.start_ns)
    if topics.is_rectified:
        remarks.append(f"{image.name} holds rectified images: P of {topic.name} is used, not K and D")
    block = camera_block(info, topic.name, rectified=topics.is_rectified)
    full, part = ("{width} x {height}".format(**size) for size in (info, block))
    if full != part:
        remarks.append(
            f"K of {topic.name}, for {full} pixels, is converted to the {part} of its binning and region of interest"
        )
    return RecordedCamera(block, info, tuple(remarks))


def _resized_block(bag: Bag, image: Topic, block: dict[str, Any]) -> dict[str, Any]:
    """Convert a `camera:` block to the size of the first image."""
    if image.is_a(VIDEOS) or (first := bag.first(image)) is None:
        raise InputError(f"--resized: found no still images in {image.name}, expected some")
    try:
        size = image_file(first).size
    except MessageError as error:
        raise InputError(f"{image.name}: {error}") from None
    return resized(block, size)
