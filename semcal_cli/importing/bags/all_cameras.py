"""Import of one camera of a recording, or of all: a drive of each, made of the same sweeps, and a rig."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE, output_drive_file
from semcal_cli.errors import InputError, OccupiedError
from semcal_cli.events import Listener, ignore
from semcal_cli.files.documents import document_text
from semcal_cli.files.input_files import check_own_file, kind_of, read_start
from semcal_cli.files.output_files import write_bytes
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.bag_import import ImportedDrive, import_bag
from semcal_cli.importing.bags.messages import Topic
from semcal_cli.importing.bags.topics import TRANSPORTS, BagRequest, topics_of_cameras

OTHER_FILES = {Path(RIG_FILE).stem, Path(DRIVE_FILE).stem, "rig_calibration"}
"""Names of files beside those of the cameras, and of the result of a rig."""
MAX_NAME = 60
"""Longest name of a camera: longer ones are no names of files on every file system."""
NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")


def import_cameras(
    request: BagRequest, out: Path, on_event: Listener = ignore, *, is_rig: bool, force: bool = False
) -> dict[str, ImportedDrive]:
    """Make the drive that is asked for, or one of each camera in one folder and a rig.yaml of them, written last.

    All drives of a rig have the sweeps that its first camera, by the name of its topic, leads to, as far as each has
    images there. An error leaves the drives of the cameras before, and no rig.yaml.

    Args:
        request: The recording, and the user's choices for each camera.
        out: Folder of the drives.
        on_event: Called with each event.
        is_rig: Whether all cameras are imported.
        force: Whether files of other data are replaced.

    Returns:
        What was written, by the name of the camera; a single drive has none.

    Raises:
        ChoiceError: there are several topics of sweeps, or of images for a single drive.
        InputError: a rig's recording has a single camera, or a camera gives no drive.
    """
    if not is_rig:
        return {"": import_bag(request, out, on_event, force=force)}
    if output_drive_file(out) == out:
        raise InputError(f"{out}: found the name of a file, expected a folder for the drives of all cameras")
    with Bag(request.paths) as bag:
        images = topics_of_cameras(bag, request)
    if len(images) < 2:
        raise InputError(
            f"{request.paths[0]}: found images of {images[0].name} alone; leave out --all-cameras"
        )
    names, path = camera_names(images), out / RIG_FILE
    document = {"semcal_rig": 1, "cameras": {name: f"{name}.yaml" for name in names}}
    content = document_text(document, "yaml").encode()
    _check_rig_file(path, content, force=force)
    done: dict[str, ImportedDrive] = {}
    for name, topic in zip(names, images, strict=True):
        first = next(iter(done.values()), None)
        camera_request = replace(
            request, image=topic.name, sweeps_ns=None if first is None else first.sweeps_ns
        )
        try:
            done[name] = import_bag(camera_request, out / f"{name}.yaml", on_event, force=force)
        except InputError as error:
            kept = f"; the drives of {', '.join(done)} are there" if done else ""
            raise InputError(f"{topic.name}: {error}{kept}") from None
        if first is None:
            # From here on, a rig that was there would join new drives and old ones.
            path.unlink(missing_ok=True)
    write_bytes(content, path)
    return done


def _check_rig_file(path: Path, content: bytes, *, force: bool) -> None:
    """Check, before the work begins, that the rig.yaml of an import replaces no other.

    Raises:
        InputError: something that is no file is in its place, or another rig and `force` is not set.
    """
    check_own_file(path)
    if kind_of(path) and not force and read_start(path, len(content) + 1) != content:
        raise OccupiedError(f"{path}: found another rig")


def camera_names(images: Sequence[Topic]) -> list[str]:
    """Name cameras after the part of their topics that tells them apart: `front` for `/front/image_raw/compressed`.

    They are numbered where that is too long, or the name of another file.
    """
    parts = [[part for part in topic.name.split("/") if part] for topic in images]
    differs = [len({*column}) > 1 for column in zip(*parts, strict=False)]
    num_common = (*differs, True).index(True)
    short = [_without_image(each[num_common:]) for each in parts]
    for named in (short, parts):
        names = [NOT_IN_NAMES.sub("_", "_".join(each)).strip("_.-") for each in named]
        files = {name.lower() for name in names} - {"", *OTHER_FILES}
        if len(files) == len(names) and max(map(len, names)) <= MAX_NAME:
            return names
    return [f"camera_{index}" for index in range(len(images))]


def _without_image(parts: Sequence[str]) -> list[str]:
    """Leave out the last parts of a topic that only say that it has images."""
    left = [*parts]
    while left and (left[-1] in TRANSPORTS or left[-1].startswith("image")):
        left.pop()
    return left
