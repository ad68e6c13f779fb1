"""Import of a recording: choose topics and frames, and write the files of a drive."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.drive.document import Frame, output_drive_file
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError, os_reason
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.input_files import is_folder, is_same_file
from semcal_cli.files.output_files import make_folder, no_empty_folder, remove_if_refused
from semcal_cli.formats.camera_block import read_intrinsics, resized
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.camera_messages import CameraInfo, camera_block, check_same, read_camera_info
from semcal_cli.importing.bags.candidates import (
    Spool,
    SpooledPair,
    choose,
    read_pairs,
    spool_pairs,
    wanted_times,
)
from semcal_cli.importing.bags.image_messages import image_file, looks_like_mosaic
from semcal_cli.importing.bags.messages import NS, VIDEOS, Message, MessageError, Topic, frame_of
from semcal_cli.importing.bags.point_messages import read_sweep
from semcal_cli.importing.bags.recorded_frames import (
    NO_TIMES,
    WrittenFrame,
    image_folder,
    with_sweeps_around,
    write_frames,
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
from semcal_cli.importing.recording import Recording
from semcal_cli.importing.sweep_odometry import Odometry

AROUND_NS = NS
"""Odometry uses sweeps from this long before the first wanted time to this long after the last, too."""
FAR_CLOCKS_S = 1.0
"""Difference between two clocks that no driver's delay explains."""
NOT_READ = "sweeps: between the times that were read"
MAX_REMARKS = 3
"""Largest number of remarks about damage in an error."""
MAX_LATCHED = 100
"""Largest number of messages of a camera that is published now and then, rather than with each image."""


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
        self.info: CameraInfo | None = None
        self.trajectory: Trajectory | None = None
        self.remarks = [
            f"{topic.name} is not used: it holds the messages of {topic.name.rpartition('/')[0]} in another encoding"
            for topic in self.topics.duplicates
        ]
        self.left_out: Counter[str] = Counter()

    def run(self) -> ImportedDrive:
        self._check_output()
        camera, request = self._camera(), self.request
        tree, moving = read_frames(self.bag)
        lidar, camera_frame = (self._first_frame(topic) for topic in (self.topics.points, self.topics.image))
        self.frame_ids = {self.topics.points: lidar, self.topics.image: camera_frame}
        rectification = self.info if self.topics.is_rectified else None
        T_camera_lidar, remarks = reference(tree, lidar, camera_frame, rectification, request.frame)
        self.remarks += remarks
        optical = optical_frame(tree, lidar, camera_frame, rectification, request.frame)
        named, remarks = FrameIds.of_recording(lidar, optical)
        self.remarks += remarks
        self.trajectory, reason = find_motion(
            self.bag, tree, moving, lidar, request.motion, request.motion_frame
        )
        self.remarks += [reason] if reason else []
        wanted_ns = wanted_times(self.bag, self.topics, request)
        odometry = self._odometry(wanted_ns) if request.odometry else None
        if odometry is not None and self.trajectory is None:
            self.trajectory = Trajectory.from_poses(odometry.poses())
            self.remarks += odometry.doubts(self.bag.start_ns)
        make_folder(self.path.parent)
        refusals: Counter[str] = Counter()
        try:
            with tempfile.TemporaryFile(dir=self.path.parent) as file:
                spool = Spool(file, self.video)
                candidates = self._candidates(spool, wanted_ns)
                self._check_replaced(candidates)
                chosen = choose(candidates, request, self.trajectory, self.left_out)
                written_frames = write_frames(
                    chosen,
                    spool,
                    camera,
                    self.topics,
                    request.bayer,
                    self.path.parent,
                    self.on_event,
                    refusals,
                    self.write,
                    request.spin,
                )
        except OSError as error:
            raise InputError(f"{self.path.parent}: cannot be written: {os_reason(error)}") from None
        if not written_frames:
            raise self._no_pair(next(iter(refusals), "none has a sweep that the first camera has"))
        self.left_out += refusals
        first_image = written_frames[0].source.image
        if first_image is not None and looks_like_mosaic(first_image):
            self.remarks.append(
                f"{self.topics.image.name} looks like the mosaic of a Bayer camera, and its messages do not state the "
                "pattern: --bayer rggb, bggr, gbrg or grbg makes colours of it"
            )
        self.remarks += list(
            dict.fromkeys(frame.times.remark for frame in written_frames if frame.times.remark)
        )
        if request.around_s is not None:
            num_frames = len(written_frames)
            written_frames = with_sweeps_around(
                written_frames,
                chosen,
                request,
                self.topics,
                self._read_sweeps,
                self.path.parent,
                self.on_event,
                self.write,
            )
            self.left_out -= Counter({NOT_READ: len(written_frames) - num_frames})
        motion, frames = None, [frame.source for frame in written_frames]
        if self.trajectory is not None:
            motion, frames, remark = write_motion(self.trajectory, written_frames, self.path, self.write)
            self.remarks.append(remark)
            if odometry is not None and self._poses_topic is not None:
                self.remarks.append(self._comparison(self._poses_topic.name, odometry, written_frames))
            if left := len(written_frames) - len(frames):
                self.left_out["pairs: no poses around them, or no point times"] += left
        recording = Recording(
            camera=camera,
            lidar=None if request.spin is None else {"spin": request.spin.model_dump()},
            frame_ids=None if named is None else named.model_dump(exclude_none=True),
            frames=frames,
            T_camera_lidar=T_camera_lidar,
            motion=motion,
            synchronization="stamps",
            remarks=(*self.remarks, *self.bag.damage_remarks()),
            read=self.read,
            labels_by=None,
        )
        written = write_drive(recording, FrameChoice(), self.path, force=True)
        pairs = [candidate.pair for candidate in chosen]
        sweeps_ns = {pair.sweep_ns: pair.sweep.received_ns for pair in pairs}
        return ImportedDrive(written, self.topics.points.span.num_messages, self.left_out, sweeps_ns)

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

    def _check_replaced(self, candidates: Sequence[SpooledPair]) -> None:
        """Check that a drive.yaml in the place of the new one is of the same topic of images, at the same time."""
        if self.force:
            return
        images = image_folder(self.path.parent, self.topics)
        # The whole recording: this run may choose, or only look for, frames at other times than the one before.
        span = [self.bag.start_ns, self.bag.end_ns, *(candidate.pair.image_ns for candidate in candidates)]

        def is_known(file: Path, frame: Frame) -> bool:
            is_beside = os.path.realpath(file.parent) == os.path.realpath(images)
            return is_beside and min(span) <= (frame.image_stamp or 0.0) * NS <= max(span)

        check_may_replace(self.path, is_known)

    def _no_pair(self, reason: str) -> InputError:
        return self._refusal(f"{self.bag.paths[0]}: found no usable pair of a sweep and an image: {reason}")

    def _refusal(self, problem: str) -> InputError:
        """Make the error of a recording that gives no drive, with what is damaged in it."""
        return InputError("; ".join([problem, *self.bag.damage_remarks()[:MAX_REMARKS]]))

    def _camera(self) -> dict[str, Any]:
        """Read the camera, converted to the size of the first image if the user says that images were resized."""
        block, image = self._stated_camera(), self.topics.image
        if not self.request.is_resized:
            return block
        if self.video is not None or (first := self.bag.first(image)) is None:
            raise InputError(f"--resized: found no still images in {image.name}, expected some")
        try:
            size = image_file(first).size
        except MessageError as error:
            raise InputError(f"{image.name}: {error}") from None
        if (converted := resized(block, size)) is None:
            sizes = [f"{width} x {height}" for width, height in (size, (block["width"], block["height"]))]
            raise InputError(
                f"--resized: found images of {sizes[0]} pixels, expected the aspect of {sizes[1]}, as K has"
            )
        return converted

    def _stated_camera(self) -> dict[str, Any]:
        """Read the camera from the user's file, or from the first message of its topic."""
        if self.request.intrinsics is not None:
            return read_intrinsics(self.request.intrinsics)
        topic, image = self.topics.camera_info, self.topics.image
        assert topic is not None
        first = self.bag.first(topic)
        if first is None:
            raise self._refusal(
                f"{topic.name}: found no whole message, expected the intrinsics, or --intrinsics FILE"
            )
        try:
            self.info = read_camera_info(first)
        except MessageError as error:
            raise InputError(f"{topic.name}: {error}") from None
        if not self.topics.is_beside:
            self.remarks.append(f"{topic.name} is not next to {image.name}; its intrinsics are used anyway")
        if topic.span.num_messages <= MAX_LATCHED:
            for message in self.bag.messages([topic]):
                check_same(message, self.info, self.bag.start_ns)
        if self.topics.is_rectified:
            self.remarks.append(
                f"{image.name} holds rectified images: P of {topic.name} is used, not K and D"
            )
        block = camera_block(self.info, topic.name, rectified=self.topics.is_rectified)
        full, part = ("{width} x {height}".format(**size) for size in (self.info, block))
        if full != part:
            self.remarks.append(
                f"K of {topic.name}, for {full} pixels, is converted to the {part} of its binning and region of "
                "interest"
            )
        return block

    def _first_frame(self, topic: Topic) -> str:
        """Read the frame of the first message that has one, among the first few."""
        frames = map(frame_of, islice(self.bag.messages([topic]), MAX_LATCHED))
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
                sweep = read_sweep(message, stamp_ns, request.spin)
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
        info = None if self.info is None else self.topics.camera_info
        poses = self._poses_topic
        topics = [topic for topic in (*self.frame_ids, info, poses) if topic is not None]
        if self.video is not None:
            self.video.seek(start_ns)
        for stored in self.bag.messages(topics, start_ns, stop_ns):
            is_frame = self.video is not None and stored.topic == self.topics.image
            message = self.video.take(stored) if self.video is not None and is_frame else stored
            needed = self.frame_ids.get(message.topic)
            if message.topic == info:
                check_same(message, self.info, self.bag.start_ns)
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
