"""Import of a recording: choose topics and frames, and write the files of a drive."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.document import output_drive_file
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError, os_reason
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.input_files import is_folder, is_same_file
from semcal_cli.files.output_files import make_folder, no_empty_folder, remove_if_refused
from semcal_cli.geometry.arrays import Pose
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.camera_messages import check_same
from semcal_cli.importing.bags.candidates import (
    Spool,
    SpooledPair,
    choose,
    read_pairs,
    spool_pairs,
    wanted_times,
)
from semcal_cli.importing.bags.image_messages import looks_like_mosaic
from semcal_cli.importing.bags.messages import VIDEOS, Message, MessageError, Topic, frame_of
from semcal_cli.importing.bags.point_messages import read_sweep
from semcal_cli.importing.bags.recorded_camera import recorded_camera
from semcal_cli.importing.bags.recorded_frames import (
    NO_TIMES,
    FrameWriter,
    WrittenFrame,
    form_of_open_times,
    write_motion,
)
from semcal_cli.importing.bags.recorded_motion import Trajectory, find_motion, read_frames
from semcal_cli.importing.bags.stamped_pairs import Pairing
from semcal_cli.importing.bags.topics import BagRequest, choose_topics
from semcal_cli.importing.bags.transforms import optical_frame, reference
from semcal_cli.importing.bags.video import Video
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import WrittenDrive, check_may_replace, write_drive
from semcal_cli.importing.motion_agreement import compare_motions
from semcal_cli.importing.recording import Recording, SourceFrame
from semcal_cli.importing.sweep_odometry import Odometry

AROUND_NS = NS
"""Odometry uses sweeps from this long before the first wanted time to this long after the last, too."""
FAR_CLOCKS_S = 1.0
"""Difference between two clocks that no driver's delay explains."""
NOT_READ = "sweeps: between the times that were read"
MAX_WITHOUT_FRAME = 100
"""Largest number of messages in which the name of a frame is searched."""


class ImportedDrive(NamedTuple):
    """Summary of an import."""

    written: WrittenDrive
    """The drive."""
    num_sweeps: int
    """Number of sweeps in the recording."""
    left_out: Counter[str]
    """Number of sweeps, images and pairs that were read and left out, by kind and reason."""
    sweeps_ns: dict[int, int]
    """Stamps of the sweeps that were chosen, and when these were received, nanoseconds."""


def import_bag(
    request: BagRequest, out: Path, on_event: Listener = ignore, *, force: bool = False
) -> ImportedDrive:
    """Make a drive of a recording. The drive.yaml is written last, and each file as a whole or not at all.

    Errors leave no new file. Files are named after their topic and stamp, so a second import writes the same files, and
    several cameras of one recording can share a folder.

    Args:
        request: The recording, and the user's choices.
        out: Folder of the drive, or its drive.yaml.
        on_event: Called with each event.
        force: Whether a drive.yaml of other data, or any other file in its place, is replaced.

    Raises:
        InputError: the recording has no usable pairs, contradicts itself or the request, or the drive.yaml is there and
            is not one of this recording.
    """
    folder = output_drive_file(out).parent
    with Bag(request.paths) as bag, no_empty_folder(folder), remove_if_refused(folder) as write:
        return _Import(bag, request, out, on_event, write, force).run()


class _Mounting(NamedTuple):
    """What a recording states about how the LiDAR and the camera are mounted."""

    T_camera_lidar: Pose | None
    """(4, 4) metres; None if no fixed transforms connect them."""
    frame_ids: FrameIds | None
    """Names of their frames; None if the recording does not name them."""


class _Import:
    def __init__(
        self,
        bag: Bag,
        request: BagRequest,
        out: Path,
        on_event: Listener,
        write: Callable[[bytes, Path], None],
        force: bool,
    ) -> None:
        self.bag, self.request, self.on_event = bag, request, on_event
        self.write, self.force = write, force
        self.path = output_drive_file(out)
        self.topics = choose_topics(bag, request)
        intrinsics = [] if request.intrinsics is None else [request.intrinsics]
        self.read = (*bag.files, *intrinsics)
        is_video = self.topics.image.is_a(VIDEOS)
        self.video = Video(bag, self.topics.image) if is_video else None
        self.trajectory: Trajectory | None = None
        self.remarks = [
            f"{topic.name} is not used: it holds the messages of {topic.name.rpartition('/')[0]} in another encoding"
            for topic in self.topics.duplicates
        ]
        self.left_out: Counter[str] = Counter()

    def run(self) -> ImportedDrive:
        self._check_output()
        self.camera = recorded_camera(self.bag, self.request, self.topics)
        self.remarks += self.camera.remarks
        mounting = self._read_mounting()
        wanted_ns = wanted_times(self.bag, self.topics, self.request)
        odometry = self._odometry(wanted_ns) if self.request.odometry else None
        self._use_odometry(odometry)
        writer = FrameWriter(
            self.camera.block, self.topics, self.request, self.path.parent, self.write, self.on_event
        )
        chosen, written_frames = self._write_frames(writer, wanted_ns)
        motion, frames = self._write_motion(written_frames, odometry)
        recording = self._recording(mounting, motion, frames)
        recording = replace(recording, point_form=form_of_open_times(written_frames))
        written = write_drive(recording, FrameChoice(), self.path, force=True)
        pairs = [candidate.pair for candidate in chosen]
        sweeps_ns = {pair.sweep_ns: pair.sweep.received_ns for pair in pairs}
        return ImportedDrive(written, self.topics.points.span.num_messages, self.left_out, sweeps_ns)

    def _read_mounting(self) -> _Mounting:
        """Read what the recording states about the LiDAR and the camera, and which topic states the motion."""
        tree, moving = read_frames(self.bag)
        lidar, camera_frame = (self._first_frame(topic) for topic in (self.topics.points, self.topics.image))
        self.frame_ids = {self.topics.points: lidar, self.topics.image: camera_frame}
        axes, rectification = self.request.frame, self.camera.info if self.topics.is_rectified else None
        T_camera_lidar, remarks = reference(tree, lidar, camera_frame, rectification, axes)
        self.remarks += remarks
        optical = optical_frame(tree, lidar, camera_frame, rectification, axes)
        named, remarks = FrameIds.of_recording(lidar, optical)
        self.remarks += remarks
        self.trajectory, reason = find_motion(
            self.bag, tree, moving, lidar, self.request.motion, self.request.motion_frame
        )
        self.remarks += [reason] if reason else []
        return _Mounting(T_camera_lidar, named)

    def _use_odometry(self, odometry: Odometry | None) -> None:
        """Take the motion from the sweeps if no topic states it."""
        if odometry is not None and self.trajectory is None:
            self.trajectory = Trajectory.from_poses(odometry.poses())
            self.remarks += odometry.doubts(self.bag.start_ns)

    def _write_frames(
        self, writer: FrameWriter, wanted_ns: Sequence[int]
    ) -> tuple[list[SpooledPair], list[WrittenFrame]]:
        """Choose pairs near wanted times, and write their frames and the sweeps around these, by time."""
        make_folder(writer.folder)
        try:
            with tempfile.TemporaryFile(dir=writer.folder) as file:
                spool = Spool(file, self.video)
                candidates = self._candidates(spool, wanted_ns)
                self._check_replaced(candidates, writer.image_folder)
                chosen = choose(candidates, self.request, self.trajectory, self.left_out)
                written, refusals = writer.write_frames(chosen, spool)
        except OSError as error:
            raise InputError(f"{writer.folder}: cannot be written: {os_reason(error)}") from None
        if not written:
            raise self._no_pair(next(iter(refusals), "none has a sweep that the first camera has"))
        self.left_out += refusals
        self._remark_on(written)
        if self.request.around_s is not None:
            num_frames = len(written)
            written = writer.with_sweeps_around(written, chosen, self._read_sweeps)
            self.left_out -= Counter({NOT_READ: len(written) - num_frames})
        return chosen, written

    def _remark_on(self, written: Sequence[WrittenFrame]) -> None:
        """Remark on the colours of the images and the times of the points."""
        first_image = written[0].source.image
        if first_image is not None and looks_like_mosaic(first_image):
            self.remarks.append(
                f"{self.topics.image.name} looks like the mosaic of a Bayer camera, and its messages do not state the "
                "pattern: --bayer rggb, bggr, gbrg or grbg makes colours of it"
            )
        self.remarks += dict.fromkeys(frame.times.remark for frame in written if frame.times.remark)

    def _write_motion(
        self, written: Sequence[WrittenFrame], odometry: Odometry | None
    ) -> tuple[dict[str, Any] | None, list[SourceFrame]]:
        """Write the poses if there are any; return the `motion:` block and the frames that they cover."""
        if self.trajectory is None:
            return None, [frame.source for frame in written]
        motion, frames, remark = write_motion(self.trajectory, written, self.path, self.write)
        self.remarks.append(remark)
        if odometry is not None and self._poses_topic is not None:
            self.remarks.append(self._comparison(self._poses_topic.name, odometry, written))
        if left := len(written) - len(frames):
            self.left_out["pairs: no poses around them, or no point times"] += left
        return motion, frames

    def _recording(
        self, mounting: _Mounting, motion: dict[str, Any] | None, frames: Sequence[SourceFrame]
    ) -> Recording:
        lidar, named = self.request.lidar, mounting.frame_ids
        return Recording(
            camera=self.camera.block,
            lidar=None if lidar is None else lidar.model_dump(mode="json", exclude_unset=True),
            frame_ids=None if named is None else named.model_dump(exclude_none=True),
            frames=frames,
            T_camera_lidar=mounting.T_camera_lidar,
            motion=motion,
            synchronization="stamps",
            remarks=(*self.remarks, *self.bag.damage_remarks()),
            read=self.read,
            labels_by=None,
        )

    def _read_sweeps(self, start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield sweeps; poses are handled here."""
        poses, points = self._poses_topic, self.topics.points
        for message in self.bag.messages([points] if poses is None else [points, poses], start_ns, stop_ns):
            if self.trajectory is not None and message.topic == poses:
                self.trajectory.take(message, self.request.by_receipt)
            elif frame_of(message) == self.frame_ids[points]:
                yield message

    def _check_output(self) -> None:
        """Check, before the work begins, that the drive.yaml replaces no file that is read."""
        if is_folder(self.path):
            raise InputError(f"{self.path}: is a folder, expected a file to write to")
        if any(is_same_file(self.path, file) for file in self.read):
            raise InputError(f"{self.path}: found a file that this import reads; choose another name")
        if not self.force:
            check_may_replace(self.path, lambda file, frame: True)

    def _check_replaced(self, candidates: Sequence[SpooledPair], images: Path) -> None:
        """Check that a drive.yaml in the place of the new one is of the same topic of images, at the same time."""
        if self.force:
            return
        # The whole recording: this run may choose, or only look for, frames at other times than the one before.
        span = [self.bag.start_ns, self.bag.end_ns, *(candidate.pair.image_ns for candidate in candidates)]

        def is_known(file: Path, frame: Frame) -> bool:
            is_beside = os.path.realpath(file.parent) == os.path.realpath(images)
            return is_beside and min(span) <= (frame.image_stamp or 0.0) * NS <= max(span)

        check_may_replace(self.path, is_known)

    def _no_pair(self, reason: str) -> InputError:
        return self.bag.refusal(
            f"{self.bag.paths[0]}: found no usable pair of a sweep and an image: {reason}"
        )

    def _first_frame(self, topic: Topic) -> str:
        """Read the frame of the first message that has one, among the first few."""
        frames = map(frame_of, islice(self.bag.messages([topic]), MAX_WITHOUT_FRAME))
        return next((frame for frame in frames if frame is not None), "")

    def _odometry(self, wanted_ns: Sequence[int]) -> Odometry | None:
        """Estimate the motion from all sweeps between the first and the last wanted time, and around them.

        None if the points of the first have no times, by which the motion would deskew them, and no topic is to be
        compared.
        """
        odometry, request = Odometry(), self.request
        start_ns, stop_ns = min(wanted_ns) - AROUND_NS, max(wanted_ns) + AROUND_NS
        for message in self.bag.messages([self.topics.points], start_ns, stop_ns):
            read_ns, all_ns = message.received_ns - start_ns, stop_ns - start_ns
            self.on_event(Progress("estimating the motion from the sweeps", read_ns, all_ns))
            if frame_of(message) != self.frame_ids[self.topics.points]:
                continue
            with suppress(MessageError):
                stamp_ns = message.received_ns if request.by_receipt else message.header_ns
                sweep = read_sweep(message, stamp_ns, request.lidar)
                if sweep.times.reference is None and self.trajectory is None:
                    self.remarks.append(f"the motion of the LiDAR is not estimated: points {NO_TIMES}")
                    return None
                odometry.add(sweep.points, None if sweep.seconds is None else sweep.seconds.ravel(), stamp_ns)
        return odometry

    def _comparison(self, name: str, odometry: Odometry, written: Sequence[WrittenFrame]) -> str:
        """Describe whether the topic of the motion agrees with the sweeps."""
        assert self.trajectory is not None
        moments_ns = [frame.moments_ns[0] for frame in written]
        difference = compare_motions(self.trajectory.poses, odometry.poses(), moments_ns)
        if difference is None:
            return (
                f"{name} could not be compared with the sweeps' motion: no frame has poses of both around it"
            )
        return f"{difference.describe(name)}{'' if difference.agrees else '; --motion none uses that of the sweeps'}"

    def _candidates(self, spool: Spool, wanted_ns: Sequence[int]) -> list[SpooledPair]:
        """Read pairs near wanted times, and check on the way that the camera stays the same."""
        rate_hz = self.topics.points.rate_hz
        pairing = Pairing(
            wanted_ns,
            round(self.request.max_gap_s * NS),
            by_receipt=self.request.by_receipt,
            image_topic=self.topics.image,
            period_ns=round(NS / rate_hz) if rate_hz else 0,
        )

        def on_place(done: int, count: int) -> None:
            self.on_event(Progress(f"reading {self.bag.paths[0].name}", done, count))

        trajectory = None if self._poses_topic is None else self.trajectory
        pairs = read_pairs(self.bag, wanted_ns, pairing, self._read_messages, trajectory, on_place)
        candidates = spool_pairs(pairs, spool, self.left_out)
        self.left_out += pairing.left_out
        self._check_clocks(pairing, len(candidates))
        num_read = len(candidates) + sum(
            n for reason, n in self.left_out.items() if not reason.startswith("images")
        )
        not_read = self.topics.points.span.num_messages - num_read
        if not_read > 0:
            self.left_out[NOT_READ] += not_read
        return candidates

    @property
    def _poses_topic(self) -> Topic | None:
        """The topic whose messages state the motion, if there is one."""
        source = None if self.trajectory is None else self.trajectory.source
        return None if source is None else source.topic

    def _read_messages(self, start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield sweeps and images; poses and cameras are handled here."""
        info = None if self.camera.info is None else self.topics.camera_info
        poses = self._poses_topic
        topics = [topic for topic in (*self.frame_ids, info, poses) if topic is not None]
        if self.video is not None:
            self.video.seek(start_ns)
        for stored in self.bag.messages(topics, start_ns, stop_ns):
            is_frame = self.video is not None and stored.topic == self.topics.image
            message = self.video.take(stored) if self.video is not None and is_frame else stored
            needed = self.frame_ids.get(message.topic)
            if message.topic == info:
                check_same(message, self.camera.info, self.bag.start_ns)
            elif self.trajectory is not None and message.topic == poses:
                self.trajectory.take(message, self.request.by_receipt)
            elif (frame := frame_of(message)) is not None and frame != needed:
                kind = "sweeps" if message.topic == self.topics.points else "images"
                self.left_out[f"{kind}: found frame {frame!r}, expected {needed!r}"] += 1
            else:
                yield message

    def _check_clocks(self, pairing: Pairing, count: int) -> None:
        """Detect that the clocks of LiDAR and camera differ, by how late their messages were received."""
        sweeps, images = (pairing.delays_s[is_image] for is_image in (False, True))
        difference_s = float(np.median(sweeps) - np.median(images)) if sweeps and images else 0.0
        names = f"{self.topics.points.name} and {self.topics.image.name}"
        remark = f"the clocks of {names} differ by {difference_s:.3f} s"
        are_apart = abs(difference_s) > FAR_CLOCKS_S
        if not count:
            common = self.left_out.most_common(1) or [("no sweeps and images at the same times", 0)]
            raise self._no_pair(f"{remark}; try --stamps receive" if are_apart else common[0][0])
        if are_apart:
            self.remarks.append(f"{remark}, judging by when their messages were received")
