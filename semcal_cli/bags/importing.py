"""A drive from a recording: its topics, its frames, and the files that are written of them."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.bags.bag import Bag
from semcal_cli.bags.cameras import CameraInfo, camera_block, read_camera_info
from semcal_cli.bags.candidates import (
    Candidate,
    Spool,
    longest_ascending,
    most_different,
    read_pairs,
    spooled,
    wanted_times,
    way_m,
)
from semcal_cli.bags.frames import write_frames, write_motion
from semcal_cli.bags.messages import NS, Message, MessageError
from semcal_cli.bags.motion import TF_STATIC, Trajectory, find_motion, read_frames
from semcal_cli.bags.pairs import Pairing
from semcal_cli.bags.topics import MAX_FRAMES, Request, Topics, choose_topics
from semcal_cli.bags.transforms import FrameTree
from semcal_cli.datasets.intrinsics import read_intrinsics
from semcal_cli.datasets.recording import Recording
from semcal_cli.datasets.writing import Options, Written, write_drive
from semcal_cli.drive.output import output_drive_file
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.messages import listed, os_reason
from semcal_cli.files.reading import is_folder, is_same_file
from semcal_cli.files.writing import make_folder
from semcal_cli.formats.values import rigid
from semcal_cli.geometry.poses import Pose

FAR_CLOCKS_S = 1.0
"""Difference between two clocks that no driver's delay explains."""
MAX_LATCHED = 100
"""Messages of a camera that is stated now and then; those of one that comes with each picture are more."""


class ImportedDrive(NamedTuple):
    """Summary of an import."""

    written: Written
    """The drive."""
    num_sweeps: int
    """Number of sweeps in the recording."""
    left_out: Counter[str]
    """What was looked at and left out, by what and why."""


def import_bag(request: Request, out: Path, on_event: Listener = ignore) -> ImportedDrive:
    """Make a drive of a recording. The drive.yaml is written last, and each file as a whole or not at all.

    Files are named by the topic and the stamp that they come from, so that a second import writes the same files, and
    several cameras of one recording can share a folder.

    Args:
        request: The recording, and what is wanted of it.
        out: Folder of the drive, or its drive.yaml.
        on_event: Called with each event.

    Raises:
        InputError: the recording has no usable pairs, or contradicts itself or the request.
    """
    with Bag(request.paths) as bag:
        return _Import(bag, request, out, on_event).run()


class _Import:
    def __init__(self, bag: Bag, request: Request, out: Path, on_event: Listener) -> None:
        self.bag, self.request, self.on_event = bag, request, on_event
        self.path = output_drive_file(out)
        self.topics: Topics = choose_topics(bag, request)
        self.info: CameraInfo | None = None
        self.frame_ids: tuple[str, ...] = ("", "")
        self.remarks: list[str] = []
        self.left_out: Counter[str] = Counter()

    def run(self) -> ImportedDrive:
        self._check_output()
        camera = self._camera()
        tree, moving = read_frames(self.bag)
        lidar, optical = self.frame_ids = tuple(map(self._frame_id, (self.topics.points, self.topics.image)))
        reference = self._reference(tree, lidar, optical)
        request = self.request
        source, why = find_motion(self.bag, tree, moving, lidar, request.motion, request.motion_frame)
        self.remarks += [why] if why else []
        trajectory = None if source is None else Trajectory(source)
        make_folder(self.path.parent)
        try:
            with tempfile.TemporaryFile(dir=self.path.parent) as file:
                spool = Spool(file)
                candidates = self._candidates(spool, trajectory)
                chosen = self._chosen(candidates, trajectory)
                found = write_frames(chosen, spool, camera, self.topics, self.path.parent, self.on_event)
        except OSError as error:
            raise InputError(f"{self.path.parent}: cannot be written: {os_reason(error)}") from None
        self.left_out += found.left_out
        if not found.frames:
            reason = next(iter(found.left_out))
            raise InputError(f"{self.bag.paths[0]}: found no usable pair of a sweep and a picture: {reason}")
        self.remarks += list(dict.fromkeys(each.remark for each in found.times if each.remark))
        motion, frames = None, found.frames
        if trajectory is not None:
            motion, frames, told = write_motion(trajectory, found, self.path)
            self.remarks.append(told)
            if left := len(found.frames) - len(frames):
                self.left_out["pairs: no poses around them, or no times of points"] += left
        recording = Recording(
            camera=camera,
            frames=frames,
            T_camera_lidar=reference,
            motion=motion,
            remarks=(*self.remarks, *self.bag.damage_remarks()),
            read=tuple(self._read),
            labels_by=None,
        )
        written = write_drive(recording, Options(), self.path)
        return ImportedDrive(written, self.topics.points.span.num_messages, self.left_out)

    def _check_output(self) -> None:
        """Check before the work begins that the drive.yaml replaces nothing that is read."""
        if is_folder(self.path):
            raise InputError(f"{self.path}: is a folder, needed a file to write to")
        if any(is_same_file(self.path, file) for file in self._read):
            raise InputError(f"{self.path}: found a file that this import reads, needed another name")

    @property
    def _read(self) -> list[Path]:
        intrinsics = [] if self.request.intrinsics is None else [self.request.intrinsics]
        return [*self.bag.files, *intrinsics]

    def _camera(self) -> dict[str, Any]:
        """Read the camera from the file that is given, or from the first message about it."""
        if self.request.intrinsics is not None:
            return read_intrinsics(self.request.intrinsics)
        topic = self.topics.camera_info
        assert topic is not None
        first = self.bag.first(topic)
        if first is None:
            raise InputError(
                f"{topic.name}: found no whole message, needed a camera; or give --intrinsics FILE"
            )
        try:
            self.info = read_camera_info(first)
        except MessageError as error:
            raise InputError(f"{topic.name}: {error}") from None
        if not self.topics.is_beside:
            self.remarks.append(
                f"{topic.name} does not lie beside {self.topics.image.name}; its camera is taken"
            )
        if topic.span.num_messages <= MAX_LATCHED:
            for message in self.bag.messages([topic]):
                self._check_same(message)
        if self.topics.is_rectified:
            self.remarks.append(
                f"{self.topics.image.name} holds rectified pictures: P of {topic.name} counts, not K and D"
            )
        return camera_block(self.info, topic.name, rectified=self.topics.is_rectified)

    def _frame_id(self, topic: Any) -> str:
        first = self.bag.first(topic)
        return "" if first is None else self._frame_of(first)

    def _frame_of(self, message: Message) -> str:
        try:
            return message.frame_id
        except MessageError:
            return ""

    def _reference(self, tree: FrameTree, lidar: str, optical: str) -> Pose | None:
        """Find T_camera_lidar (4, 4), metres, in the fixed transforms."""
        if tree.changed:
            edges = listed(f"{parent} to {child}" for parent, child in sorted(tree.changed))
            self.remarks.append(f"{TF_STATIC} states several transforms of {edges}: the last counts")
        if lidar == optical:
            self.remarks.append(
                f"no reference: sweeps and pictures both say that they are in frame {lidar!r}"
            )
            return None
        reached = tree.reached(optical)
        if lidar in reached and tree.contradictory:
            places = listed(sorted(tree.contradictory))
            self.remarks.append(f"no reference: fixed transforms contradict one another at {places}")
            return None
        T = reached.get(lidar)
        if T is None or not lidar:
            self.remarks.append(f"no reference from {lidar!r} to {optical!r}: {tree.missing(lidar, optical)}")
            return None
        if self.info is not None and self.topics.is_rectified:
            if self.info.P[3] or self.info.P[7]:
                self.remarks.append(
                    "no reference: P is that of the second camera of a stereo pair, whose frame is not stated"
                )
                return None
            R = np.reshape(self.info.R, (3, 3))
            T[:3] = (R if R.any() else np.eye(3)) @ T[:3]
            T = rigid(f"{self.topics.image.name}: R of its camera", T)
        self.remarks.append(f"the reference T_camera_lidar is the recording's, from {lidar!r} to {optical!r}")
        return T

    def _candidates(self, spool: Spool, trajectory: Trajectory | None) -> list[Candidate]:
        """Read pairs near evenly spaced times, and check on the way that the camera stays the same."""
        request = self.request
        wanted = wanted_times(self.bag, self.topics, request)
        rate_hz = self.topics.points.rate_hz
        pairing = Pairing(
            wanted,
            round(request.max_gap_s * NS),
            by_receipt=request.by_receipt,
            picture_topic=self.topics.image,
            period_ns=round(NS / rate_hz) if rate_hz else 0,
        )
        began = perf_counter()

        def on_place(done: int, count: int) -> None:
            left = f", {(perf_counter() - began) / done * (count - done):.0f} s left" if done else ""
            self.on_event(Progress(f"reading {self.bag.paths[0].name}: {done} of {count} places{left}"))

        def on_error(error: MessageError) -> None:
            self.left_out[f"pairs: picture: {error}"] += 1

        def watched(start: int, stop: int) -> Iterator[Message]:
            return self._watched(start, stop, trajectory)

        pairs = read_pairs(self.bag, wanted, pairing, watched, trajectory, on_place)
        found = spooled(pairs, spool, on_error)
        self.left_out += pairing.left_out
        self._check_clocks(pairing, len(found))
        looked_at = len(found) + sum(n for why, n in self.left_out.items() if not why.startswith("pictures"))
        not_read = self.topics.points.span.num_messages - looked_at
        if not_read > 0:
            self.left_out["sweeps: lie between the times that were looked at"] += not_read
        return found

    def _watched(self, start: int, stop: int, trajectory: Trajectory | None) -> Iterator[Message]:
        """Yield sweeps and pictures; poses and cameras are looked at here."""
        topics = [self.topics.points, self.topics.image]
        if self.info is not None and self.topics.camera_info is not None:
            topics.append(self.topics.camera_info)
        if trajectory is not None:
            topics.append(trajectory.source.topic)
        frames = {self.topics.points: self.frame_ids[0], self.topics.image: self.frame_ids[1]}
        for message in self.bag.messages(topics, start, stop):
            if message.topic == self.topics.camera_info:
                self._check_same(message)
            elif trajectory is not None and message.topic == trajectory.source.topic:
                trajectory.take(message, self.request.by_receipt)
            elif (frame := self._frame_of(message)) != frames[message.topic]:
                what = "sweeps" if message.topic == self.topics.points else "pictures"
                self.left_out[f"{what}: found frame {frame!r}, needed {frames[message.topic]!r}"] += 1
            else:
                yield message

    def _check_same(self, message: Message) -> None:
        assert self.info is not None
        try:
            difference = read_camera_info(message).difference(self.info)
        except MessageError:
            return
        if difference is not None:
            seconds = (message.received_ns - self.bag.start_ns) / NS
            found = f"found another camera {seconds:.3f} s after the start: {difference}"
            raise InputError(f"{message.topic.name}: {found}; needed the same throughout")

    def _check_clocks(self, pairing: Pairing, count: int) -> None:
        """Notice clocks of the LiDAR and of the camera that differ, by how late messages were received."""
        sweeps, pictures = (pairing.delays_s[is_picture] for is_picture in (False, True))
        apart = ""
        if sweeps and pictures:
            difference_s = float(np.median(sweeps) - np.median(pictures))
            if abs(difference_s) > FAR_CLOCKS_S:
                names = f"{self.topics.points.name} and {self.topics.image.name}"
                apart = f"the clocks of {names} differ by {difference_s:.3f} s"
        if not count:
            common = self.left_out.most_common(1) or [("no sweeps and pictures at the same times", 0)]
            reason = apart or common[0][0]
            advice = "; try --stamps receive" if apart else ""
            raise InputError(
                f"{self.bag.paths[0]}: found no usable pair of a sweep and a picture: {reason}{advice}"
            )
        if apart:
            self.remarks.append(f"{apart}, judged by when their messages were received")

    def _chosen(self, candidates: Sequence[Candidate], trajectory: Trajectory | None) -> list[Candidate]:
        """Choose the pairs whose scenes differ most, in order of time."""
        kept = longest_ascending([each.pair.sweep_ns for each in candidates])
        forward = [candidates[index] for index in kept]
        if left := len(candidates) - len(forward):
            self.left_out["pairs: their stamps run backwards"] += left
        if self.request.every_s is not None:
            count = self.request.max_frames or len(forward)
            if len(forward) > count:
                self.left_out["pairs: more than --max-frames"] += len(forward) - count
            return forward[:count]
        count = self.request.max_frames or MAX_FRAMES
        if len(forward) <= count:
            return forward
        way = None
        if trajectory is not None:
            way = way_m([trajectory.position(each.pair.sweep_ns) for each in forward])
        kept = most_different([each.look for each in forward], count, way)
        why = "others are spread better along the way"
        if way is None:
            why = "their pictures are like those of others"
        self.left_out[f"pairs: {why}"] += len(forward) - len(kept)
        return [forward[index] for index in kept]
