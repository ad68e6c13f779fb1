"""The files of a drive's frames: sweeps, images, and the poses of the LiDAR.

They are named after their topic and stamp, and written as a whole or not at all.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from semcal_cli.drive.lidar import Spin
from semcal_cli.events import Listener, Progress
from semcal_cli.formats.camera_block import resized
from semcal_cli.importing.bags.candidates import Spool, SpooledPair
from semcal_cli.importing.bags.image_messages import Bayer, image_file
from semcal_cli.importing.bags.messages import NS, Message, MessageError
from semcal_cli.importing.bags.point_messages import PointTimes, read_sweep
from semcal_cli.importing.bags.recorded_motion import Trajectory
from semcal_cli.importing.bags.stamped_pairs import PATIENCE_NS
from semcal_cli.importing.bags.topics import BagRequest, Topics
from semcal_cli.importing.recording import SourceFrame
from semcal_cli.importing.sweep_odometry import SIGMA, seconds_text

MAX_NAME = 100
"""Longest topic name that is a folder's name as it is; longer ones are cut, and a hash is added."""
NUM_WRITERS = 2
"""Number of frames that are written at a time."""
NO_TIMES = "have no times, by which it would deskew them (`semcal import bag --spin` gives them)"
"""Why points are not deskewed by a motion."""


class WrittenFrame(NamedTuple):
    """A frame whose files are written."""

    source: SourceFrame
    """The frame."""
    times: PointTimes
    """Times of its points."""

    @property
    def moments_ns(self) -> list[int]:
        """The times at which poses are needed: of the image, if any, and of the first and the last point."""
        points_s, image_s = self.source.points_stamp or 0.0, self.source.image_stamp
        ends_s = [points_s + end_s for end_s in self.times.ends_s]
        return [round(moment_s * NS) for moment_s in (points_s if image_s is None else image_s, *ends_s)]


def write_frames(
    chosen: Sequence[SpooledPair],
    spool: Spool,
    camera: dict[str, Any],
    topics: Topics,
    bayer: Bayer | None,
    folder: Path,
    on_event: Listener,
    left_out: Counter[str],
    write: Callable[[bytes, Path], None],
    spin: Spin | None = None,
) -> list[WrittenFrame]:
    """Write the files of frames, two at a time, in order of time.

    Args:
        chosen: The pairs.
        spool: Their messages.
        camera: The `camera:` block of the drive.
        topics: The topics that they come from.
        bayer: Pattern of images that are mosaics; None for those that the messages name.
        folder: Folder of the drive.
        on_event: Called with each event.
        left_out: Counts the pairs that cannot be used, by reason.
        write: Writes the content of a file to its path.
        spin: How the LiDAR turns, which gives the times of points that have none.

    Raises:
        InputError: a file cannot be written.
    """

    def written_frame(candidate: SpooledPair) -> WrittenFrame | MessageError:
        try:
            return _write_frame(candidate, spool, camera, topics, bayer, folder, write, spin)
        except MessageError as error:
            return error

    written = []
    with ThreadPoolExecutor(NUM_WRITERS) as workers:
        for index, result in enumerate(workers.map(written_frame, chosen)):
            on_event(Progress("writing frames", index, len(chosen)))
            if isinstance(result, MessageError):
                left_out[f"pairs: {result}"] += 1
            else:
                written.append(result)
    return written


def write_motion(
    trajectory: Trajectory,
    written: Sequence[WrittenFrame],
    drive: Path,
    write: Callable[[bytes, Path], None],
) -> tuple[dict[str, Any] | None, list[SourceFrame], str]:
    """Write the poses of the LiDAR with `write`, if the points of most frames have times to deskew them by.

    Returns:
        The `motion:` block of the drive, the frames that the poses cover, and a sentence about it; without a block,
        all frames.

    Raises:
        InputError: the file cannot be written.
    """
    remark = trajectory.description
    references = Counter(frame.times.reference for frame in written if frame.times.reference)
    ((reference, num_timed),) = references.most_common(1) or [("relative", 0)]
    covered = [
        frame.source
        for frame in written
        if frame.times.reference == reference and trajectory.covers(*frame.moments_ns)
    ]
    if 2 * min(num_timed, len(covered)) < len(written):
        reason = "there are no poses around most frames"
        if 2 * num_timed < len(written):
            reason = f"most points {NO_TIMES}"
        return None, [frame.source for frame in written], f"{remark}, but {reason}; no motion is written"
    # The poses depend on the chosen frames, so the file belongs to this drive alone.
    path = drive.parent / "poses" / f"{drive.stem}.txt"
    write(trajectory.tum().encode(), path)
    block: dict[str, Any] = {"poses": path.relative_to(drive.parent).as_posix(), "point_times": reference}
    if trajectory.source is None:
        block["sigma"] = SIGMA
    return block, covered, f"{remark}; the drive uses it"


def _write_frame(
    candidate: SpooledPair,
    spool: Spool,
    camera: dict[str, Any],
    topics: Topics,
    bayer: Bayer | None,
    folder: Path,
    write: Callable[[bytes, Path], None],
    spin: Spin | None,
) -> WrittenFrame:
    pair = candidate.pair
    sweep_message, image_message = spool.get(candidate)
    sweep = read_sweep(sweep_message, pair.sweep_ns, spin)
    file = image_file(image_message, bayer)
    needed = camera["width"], camera["height"]
    if file.size != needed:
        image_size, camera_size = ("{} x {}".format(*size) for size in (file.size, needed))
        advice = (
            "" if resized(camera, file.size) is None else "; if the images were resized, --resized converts K"
        )
        raise MessageError(
            f"found an image of {image_size} pixels, needed {camera_size}, as its intrinsics state{advice}"
        )
    points = _sweep_file(folder, topics, pair.sweep_ns)
    image = image_folder(folder, topics) / f"{seconds_text(pair.image_ns)}{file.suffix}"
    write(sweep.pcd(), points)
    write(file.content, image)
    stamps = pair.sweep_ns / NS, pair.image_ns / NS
    frame = SourceFrame(points.stem, points, image=image, points_stamp=stamps[0], image_stamp=stamps[1])
    return WrittenFrame(frame, sweep.times)


def with_sweeps_around(
    written: Sequence[WrittenFrame],
    chosen: Sequence[SpooledPair],
    request: BagRequest,
    topics: Topics,
    read_sweeps: Callable[[int, int], Iterator[Message]],
    folder: Path,
    on_event: Listener,
    write: Callable[[bytes, Path], None],
) -> list[WrittenFrame]:
    """Write all sweeps within half of `request.around_s` from each frame, and return them and the frames by time.

    Args:
        written: The frames.
        chosen: The pairs that the frames were made of, in order of time.
        request: The user's choices.
        topics: The topics that they come from.
        read_sweeps: Function that yields the sweeps that were received from a start to before a stop.
        folder: Folder of the drive.
        on_event: Called with each event.
        write: Writes the content of a file to its path.

    Raises:
        InputError: a file cannot be written.
    """
    half_ns = round(0.5 * (request.around_s or 0.0) * NS)
    by_stamp = {round((frame.source.points_stamp or 0.0) * NS): frame for frame in written}
    middles_ns = np.array([candidate.pair.sweep_ns for candidate in chosen])
    done_ns, known_ns = 0, {*by_stamp, *middles_ns.tolist()}
    for index, candidate in enumerate(chosen):
        on_event(Progress("reading the sweeps around frames", index, len(chosen)))
        received_ns = candidate.pair.sweep.received_ns
        # Messages of one moment are received at different times, and sweeps need poses before and after them.
        start_ns = max(received_ns - half_ns - PATIENCE_NS, done_ns)
        done_ns = max(received_ns + half_ns + PATIENCE_NS, done_ns)
        for message in read_sweeps(start_ns, done_ns):
            with suppress(MessageError):
                stamp_ns = message.received_ns if request.by_receipt else message.header_ns
                if stamp_ns in known_ns or np.abs(middles_ns - stamp_ns).min() > half_ns:
                    continue
                sweep, points = (
                    read_sweep(message, stamp_ns, request.spin),
                    _sweep_file(folder, topics, stamp_ns),
                )
                write(sweep.pcd(), points)
                source = SourceFrame(points.stem, points, points_stamp=stamp_ns / NS)
                by_stamp[stamp_ns] = WrittenFrame(source, sweep.times)
                known_ns.add(stamp_ns)
    return [by_stamp[stamp_ns] for stamp_ns in sorted(by_stamp)]


def _sweep_file(folder: Path, topics: Topics, stamp_ns: int) -> Path:
    return folder / "points" / _slug(topics.points.name) / f"{seconds_text(stamp_ns)}.pcd"


def image_folder(folder: Path, topics: Topics) -> Path:
    """Name the folder of the images in the folder of a drive."""
    return folder / "images" / _slug(topics.image.name)


def _slug(topic: str) -> str:
    """Turn the name of a topic into a unique name of a folder: /camera/image_raw becomes camera.image_raw."""
    parts = (
        quote(part, safe="").replace(".", "%2E").replace("~", "%7E") for part in topic.split("/") if part
    )
    name = ".".join(parts) or "%2F"
    if len(name) <= MAX_NAME:
        return name
    return f"{name[:MAX_NAME]}-{hashlib.sha256(topic.encode()).hexdigest()[:16]}"
