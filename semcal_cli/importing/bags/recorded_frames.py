"""The files of a drive's frames: sweeps, images, and the poses of the LiDAR.

They are named after their topic and stamp, and written as a whole or not at all.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.point_files import AS_USUAL, PointForm, may_be_shares
from semcal_cli.events import Listener, Progress
from semcal_cli.formats.camera_block import size_problem
from semcal_cli.importing.bags.candidates import Spool, SpooledPair
from semcal_cli.importing.bags.image_messages import image_file
from semcal_cli.importing.bags.messages import Message, MessageError
from semcal_cli.importing.bags.point_messages import PointTimes, Sweep, read_sweep
from semcal_cli.importing.bags.recorded_motion import Trajectory
from semcal_cli.importing.bags.stamped_pairs import PATIENCE_NS, StampedPair
from semcal_cli.importing.bags.topics import BagRequest, Topics
from semcal_cli.importing.recording import SourceFrame
from semcal_cli.importing.stamps import seconds_text
from semcal_cli.importing.sweep_odometry import SIGMA

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


@dataclass(frozen=True, eq=False)
class FrameWriter:
    """Writes the sweeps and images of frames into the folder of a drive."""

    camera: dict[str, Any]
    """The `camera:` block of the drive."""
    topics: Topics
    """The topics that the messages come from."""
    request: BagRequest
    """The user's choices."""
    folder: Path
    """Folder of the drive."""
    write: Callable[[bytes, Path], None]
    """Writes the content of a file to its path."""
    on_event: Listener
    """Called with each event."""

    @property
    def image_folder(self) -> Path:
        """Folder of the images."""
        return self.folder / "images" / _slug(self.topics.image.name)

    def write_frames(
        self, chosen: Sequence[SpooledPair], spool: Spool
    ) -> tuple[list[WrittenFrame], Counter[str]]:
        """Write the files of frames, two at a time, in order of time.

        Args:
            chosen: The pairs.
            spool: Their messages.

        Returns:
            The frames, and the number of pairs that cannot be used, by reason.

        Raises:
            InputError: a file cannot be written.
        """

        def written_frame(candidate: SpooledPair) -> WrittenFrame | MessageError:
            try:
                return self._write_pair(candidate.pair, *spool.get(candidate))
            except MessageError as error:
                return error

        written, refusals = [], Counter[str]()
        with ThreadPoolExecutor(NUM_WRITERS) as workers:
            for index, result in enumerate(workers.map(written_frame, chosen)):
                self.on_event(Progress("writing frames", index, len(chosen)))
                if isinstance(result, MessageError):
                    refusals[f"pairs: {result}"] += 1
                else:
                    written.append(result)
        return written, refusals

    def with_sweeps_around(
        self,
        written: Sequence[WrittenFrame],
        chosen: Sequence[SpooledPair],
        read_sweeps: Callable[[int, int], Iterator[Message]],
    ) -> list[WrittenFrame]:
        """Write all sweeps within half of `request.around_s` from each frame, and return them and the frames by time.

        Args:
            written: The frames.
            chosen: The pairs that the frames were made of, in order of time.
            read_sweeps: Function that yields the sweeps that were received from a start to before a stop.

        Raises:
            InputError: a file cannot be written.
        """
        half_ns = round(0.5 * (self.request.around_s or 0.0) * NS)
        by_stamp = {round((frame.source.points_stamp or 0.0) * NS): frame for frame in written}
        middles_ns = np.array([candidate.pair.sweep_ns for candidate in chosen])
        done_ns, known_ns = 0, {*by_stamp, *middles_ns.tolist()}
        for index, candidate in enumerate(chosen):
            self.on_event(Progress("reading the sweeps around frames", index, len(chosen)))
            received_ns = candidate.pair.sweep.received_ns
            # Messages of one moment are received at different times, and sweeps need poses before and after them.
            start_ns = max(received_ns - half_ns - PATIENCE_NS, done_ns)
            done_ns = max(received_ns + half_ns + PATIENCE_NS, done_ns)
            for message in read_sweeps(start_ns, done_ns):
                with suppress(MessageError):
                    stamp_ns = message.received_ns if self.request.by_receipt else message.header_ns
                    if stamp_ns in known_ns or np.abs(middles_ns - stamp_ns).min() > half_ns:
                        continue
                    sweep = read_sweep(message, stamp_ns, self.request.lidar)
                    by_stamp[stamp_ns] = self._write_sweep(sweep, stamp_ns)
                    known_ns.add(stamp_ns)
        return [by_stamp[stamp_ns] for stamp_ns in sorted(by_stamp)]

    def _write_pair(self, pair: StampedPair, sweep_message: Message, image_message: Message) -> WrittenFrame:
        """Write a sweep and its image, neither of them if one is refused."""
        sweep = read_sweep(sweep_message, pair.sweep_ns, self.request.lidar)
        file = image_file(image_message, self.request.bayer)
        self._check_size(file.size)
        frame = self._write_sweep(sweep, pair.sweep_ns)
        image = self.image_folder / f"{seconds_text(pair.image_ns)}{file.suffix}"
        self.write(file.content, image)
        return frame._replace(source=replace(frame.source, image=image, image_stamp=pair.image_ns / NS))

    def _check_size(self, size: tuple[int, int]) -> None:
        if problem := size_problem(self.camera, size):
            raise MessageError(problem)

    def _write_sweep(self, sweep: Sweep, stamp_ns: int) -> WrittenFrame:
        path = self.folder / "points" / _slug(self.topics.points.name) / f"{seconds_text(stamp_ns)}.pcd"
        self.write(sweep.pcd(), path)
        return WrittenFrame(SourceFrame(path.stem, path, points_stamp=stamp_ns / NS), sweep.times)


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


def form_of_open_times(written: Sequence[WrittenFrame]) -> PointForm:
    """State the unit of times from 0 to 1, which the files alone leave open."""
    units = Counter(frame.times.unit for frame in written if may_be_shares(*frame.times.ends_s))
    return PointForm(time_unit=units.most_common(1)[0][0]) if units else AS_USUAL


def _slug(topic: str) -> str:
    """Turn the name of a topic into a unique name of a folder: /camera/image_raw becomes camera.image_raw."""
    parts = (
        quote(part, safe="").replace(".", "%2E").replace("~", "%7E") for part in topic.split("/") if part
    )
    name = ".".join(parts) or "%2F"
    if len(name) <= MAX_NAME:
        return name
    return f"{name[:MAX_NAME]}-{hashlib.sha256(topic.encode()).hexdigest()[:16]}"
