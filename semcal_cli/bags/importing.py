"""A drive from a recording: its topics, its frames, and the files that are written of them."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.bags.bag import Bag
from semcal_cli.bags.cameras import CameraInfo, camera_block, read_camera_info
from semcal_cli.bags.candidates import (
    Candidate,
    Spool,
    along,
    most_different,
    read_pairs,
    spooled,
    wanted_times,
    way_m,
)
from semcal_cli.bags.clouds import Sweep, read_sweep
from semcal_cli.bags.messages import NS, TRANSFORMS, Message, MessageError
from semcal_cli.bags.motion import TF_STATIC, Trajectory, find_motion, seconds_text
from semcal_cli.bags.pairs import Pairing
from semcal_cli.bags.pictures import Picture, read_picture
from semcal_cli.bags.topics import MAX_FRAMES, Request, Topics, choose_topics
from semcal_cli.bags.transforms import FrameTree
from semcal_cli.datasets.intrinsics import read_intrinsics
from semcal_cli.datasets.recording import Recording, SourceFrame
from semcal_cli.datasets.writing import Options, Written, write_drive
from semcal_cli.drive.document import DRIVE_FILE
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.files.messages import listed
from semcal_cli.files.writing import make_folder, write_bytes, write_text
from semcal_cli.formats.values import rigid
from semcal_cli.geometry.poses import Pose

FAR_CLOCKS_S = 1.0
"""Difference between two clocks that no driver's delay explains."""
POSES_AFTER_NS = 3 * NS // 10
"""What is read after a sweep for poses after its points."""
AT_A_TIME = 2
"""Frames that are written at a time."""


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
        self.path = out if out.suffix in (".yaml", ".yml") else out / DRIVE_FILE
        self.topics: Topics = choose_topics(bag, request)
        self.info: CameraInfo | None = None
        self.remarks: list[str] = []
        self.left_out: Counter[str] = Counter()

    def run(self) -> ImportedDrive:
        camera = self._camera()
        tree = self._tree()
        lidar, optical = (self._frame_id(topic) for topic in (self.topics.points, self.topics.image))
        reference = self._reference(tree, lidar, optical)
        source, why = find_motion(self.bag, tree, lidar, self.request.motion, self.request.motion_frame)
        self.remarks += [why] if why else []
        trajectory = None if source is None else Trajectory(source)
        make_folder(self.path.parent)
        with tempfile.TemporaryFile(dir=self.path.parent) as file:
            spool = Spool(file)
            candidates = self._candidates(spool, trajectory)
            chosen = self._chosen(candidates, trajectory)
            frames, sweeps = self._write(chosen, spool, camera)
        motion, frames = self._motion(trajectory, frames, sweeps)
        recording = Recording(
            camera=camera,
            frames=frames,
            T_camera_lidar=reference,
            motion=motion,
            remarks=(*self.remarks, *self.bag.damage_remarks()),
            labels_by=None,
        )
        written = write_drive(recording, Options(), self.path)
        return ImportedDrive(written, self.topics.points.span.num_messages, self.left_out)

    def _camera(self) -> dict[str, Any]:
        """Read the camera from the file that is given, or from the first message about it."""
        if self.request.intrinsics is not None:
            return read_intrinsics(self.request.intrinsics)
        topic = self.topics.camera_info
        assert topic is not None
        first = next(self.bag.messages([topic]), None)
        if first is None:
            raise InputError(
                f"{topic.name}: found no whole message, needed a camera; or give --intrinsics FILE"
            )
        try:
            self.info = read_camera_info(first)
        except MessageError as error:
            raise InputError(f"{topic.name}: {error}") from None
        if self.topics.is_rectified:
            self.remarks.append(
                f"{self.topics.image.name} holds rectified pictures: P of {topic.name} counts, not K and D"
            )
        return camera_block(self.info, topic.name, rectified=self.topics.is_rectified)

    def _tree(self) -> FrameTree:
        tree = FrameTree()
        static = [topic for topic in self.bag.of_types(TRANSFORMS) if topic.name == TF_STATIC]
        for message in self.bag.messages(static):
            with suppress(MessageError):
                tree.add(message)
        return tree

    def _frame_id(self, topic: Any) -> str:
        first = next(self.bag.messages([topic]), None)
        try:
            return "" if first is None else first.frame_id
        except MessageError:
            return ""

    def _reference(self, tree: FrameTree, lidar: str, optical: str) -> Pose | None:
        """Find T_camera_lidar (4, 4), metres, in the fixed transforms."""
        if tree.changed:
            edges = listed(f"{parent} to {child}" for parent, child in sorted(tree.changed))
            self.remarks.append(f"{TF_STATIC} states several transforms of {edges}: the last counts")
        T = tree.reached(optical).get(lidar)
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
        self.remarks.append(f"the reference T_camera_lidar is {TF_STATIC}'s, from {lidar!r} to {optical!r}")
        return T

    def _candidates(self, spool: Spool, trajectory: Trajectory | None) -> list[Candidate]:
        """Read pairs near evenly spaced times, and check on the way that the camera stays the same."""
        request = self.request
        wanted = wanted_times(self.bag, self.topics, request)
        names = {"by_receipt": request.by_receipt, "picture_topic": self.topics.image.name}
        pairing = Pairing(wanted, round(request.max_gap_s * NS), **names)  # type: ignore[arg-type]
        began = perf_counter()

        def on_place(done: int, count: int) -> None:
            left = f", {(perf_counter() - began) / done * (count - done):.0f} s left" if done else ""
            self.on_event(Progress(f"reading {self.bag.paths[0].name}: {done} of {count} places{left}"))

        def on_error(error: MessageError) -> None:
            self.left_out[f"pictures: {error}"] += 1

        def watched(start: int, stop: int) -> Iterator[Message]:
            return self._watched(start, stop, trajectory)

        enough_ns = 0 if trajectory is None else POSES_AFTER_NS
        pairs = read_pairs(self.bag, wanted, pairing, watched, enough_ns, on_place)
        found = spooled(pairs, spool, on_error)
        self.left_out += pairing.left_out
        self._check_clocks(pairing, len(found))
        not_read = self.topics.points.span.num_messages - len(found) - self.left_out.total()
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
        for message in self.bag.messages(topics, start, stop):
            if self.topics.camera_info is not None and message.topic == self.topics.camera_info.name:
                self._check_same(message)
            elif trajectory is not None and message.topic == trajectory.source.topic.name:
                trajectory.take(message, self.request.by_receipt)
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
            raise InputError(f"{message.topic}: {found}; needed the same throughout")

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
        forward: list[Candidate] = []
        for each in candidates:
            if forward and each.pair.sweep_ns <= forward[-1].pair.sweep_ns:
                self.left_out["pairs: their stamps run backwards"] += 1
            else:
                forward.append(each)
        count = self.request.max_frames or MAX_FRAMES
        if self.request.every_s is not None or len(forward) <= count:
            return forward
        way = (
            None
            if trajectory is None
            else way_m([trajectory.position(each.pair.sweep_ns) for each in forward])
        )
        if way is not None:
            kept = along(way, count)
            self.left_out["pairs: others are spread better along the way"] += len(forward) - len(kept)
        else:
            kept = most_different([each.look for each in forward], count)
            self.left_out["pairs: their pictures are like those of others"] += len(forward) - len(kept)
        return [forward[index] for index in kept]

    def _write(
        self, chosen: Sequence[Candidate], spool: Spool, camera: dict[str, Any]
    ) -> tuple[list[SourceFrame], list[Sweep]]:
        """Write the files of the frames, two at a time; pairs that cannot be used are counted."""
        frames, sweeps = [], []

        def write(candidate: Candidate) -> tuple[SourceFrame, Sweep] | MessageError:
            try:
                return self._write_frame(candidate, spool, camera)
            except MessageError as error:
                return error

        with ThreadPoolExecutor(AT_A_TIME) as workers:
            for index, written in enumerate(workers.map(write, chosen)):
                self.on_event(Progress(f"writing {index + 1} of {len(chosen)} frames"))
                if isinstance(written, MessageError):
                    self.left_out[f"pairs: {written}"] += 1
                else:
                    frames.append(written[0])
                    sweeps.append(written[1])
        if not frames:
            reason = next(reversed(self.left_out))
            raise InputError(f"{self.bag.paths[0]}: found no usable pair of a sweep and a picture: {reason}")
        self.remarks += list(dict.fromkeys(sweep.remark for sweep in sweeps if sweep.remark))
        return frames, sweeps

    def _write_frame(
        self, candidate: Candidate, spool: Spool, camera: dict[str, Any]
    ) -> tuple[SourceFrame, Sweep]:
        pair = candidate.pair
        sweep_message, picture_message = spool.get(candidate)
        sweep = read_sweep(sweep_message, pair.sweep_ns)
        picture = read_picture(picture_message)
        _check_size(picture, camera, self.topics.image.name)
        frame = SourceFrame(
            name=seconds_text(pair.sweep_ns),
            points=self._file("points", self.topics.points.name, pair.sweep_ns, ".pcd", sweep.pcd()),
            image=self._file(
                "images", self.topics.image.name, pair.picture_ns, picture.suffix, picture.content
            ),
            points_stamp=pair.sweep_ns / NS,
            image_stamp=pair.picture_ns / NS,
        )
        return frame, sweep._replace(records=sweep.records[:0])

    def _motion(
        self, trajectory: Trajectory | None, frames: list[SourceFrame], sweeps: Sequence[Sweep]
    ) -> tuple[dict[str, Any] | None, list[SourceFrame]]:
        """Write the poses, if the points have times that they can correct, and leave out frames beyond them."""
        if trajectory is None:
            return None, frames
        source = trajectory.source
        told = f"{source.topic.name} tells of the motion of {source.frame!r}"
        kinds = {sweep.point_times for sweep in sweeps}
        if len(kinds) > 1 or None in kinds:
            self.remarks.append(
                f"{told}, but the points have no times that it could correct; no motion is written"
            )
            return None, frames
        covered = [
            frame
            for frame, sweep in zip(frames, sweeps, strict=True)
            if trajectory.covers(*_moments_ns(frame, sweep))
        ]
        if 2 * len(covered) < len(frames):
            self.remarks.append(f"{told}, but has no poses around most frames; no motion is written")
            return None, frames
        if len(covered) < len(frames):
            self.left_out["pairs: no poses around them"] += len(frames) - len(covered)
        path = self.path.parent / "poses" / f"{_slug(source.topic.name)}.txt"
        make_folder(path.parent)
        write_text(trajectory.tum(), path)
        self.remarks.append(f"{told}: the drive's motion")
        poses = path.relative_to(self.path.parent).as_posix()
        return {"poses": poses, "point_times": kinds.pop()}, covered

    def _file(self, kind: str, topic: str, stamp_ns: int, suffix: str, content: bytes) -> Path:
        path = self.path.parent / kind / _slug(topic) / f"{seconds_text(stamp_ns)}{suffix}"
        make_folder(path.parent)
        write_bytes(content, path)
        return path


def _check_size(picture: Picture, camera: dict[str, Any], topic: str) -> None:
    size = camera["width"], camera["height"]
    if picture.size != size:
        found = "{} x {}".format(*picture.size)
        raise InputError(
            f"{topic}: found pictures of {found} pixels, needed {size[0]} x {size[1]}, as its camera states"
        )


def _moments_ns(frame: SourceFrame, sweep: Sweep) -> list[int]:
    """List the times at which poses are needed: of the picture, and of the first and the last point."""
    assert frame.points_stamp is not None
    assert frame.image_stamp is not None
    moments_s = [frame.image_stamp, *(frame.points_stamp + time for time in sweep.times_s or (0.0,))]
    return [round(moment * NS) for moment in moments_s]


def _slug(topic: str) -> str:
    """Make a name of a folder or a file of the name of a topic."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", topic.strip("/")).strip(".") or "topic"
