"""A user's own data: clouds, labels and images found by patterns, and paired by time or by name."""

from __future__ import annotations

import glob
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.data_suffixes import (
    CLOUD_SUFFIXES,
    IMAGE_LABEL_SUFFIXES,
    IMAGE_SUFFIXES,
    POINT_LABEL_SUFFIXES,
    kind_of_data,
)
from semcal_cli.config.directions import CameraFrame, Direction
from semcal_cli.config.point_files import NamedUnit, PointColumn, PointForm, PointType, may_be_shares
from semcal_cli.config.synchronization import Synchronization
from semcal_cli.drive.document import drive_file
from semcal_cli.drive.lidar import Lidar
from semcal_cli.errors import InputError, counted
from semcal_cli.files.image_files import read_size
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.files.validation import MAX_TRANSLATION_M
from semcal_cli.formats.camera_block import read_intrinsics, resized, size_problem
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.frame_names import T_BODY_OPTICAL
from semcal_cli.formats.node import rigid
from semcal_cli.formats.transform_files import REFERENCE_DIRECTION, read_extrinsic
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing.bin_columns import column_doubts
from semcal_cli.importing.body_frames import body_frame_doubts
from semcal_cli.importing.file_pairing import by_time, pairs, stamps_s, stem
from semcal_cli.importing.recording import Recording, SourceFrame
from semcal_cli.observations.point_times import deduced_unit

SUFFIXES = {
    "--points": CLOUD_SUFFIXES,
    "--point-labels": POINT_LABEL_SUFFIXES,
    "--image-labels": IMAGE_LABEL_SUFFIXES,
    "--images": IMAGE_SUFFIXES,
}
"""Suffixes of the files that are read, by the option of their pattern."""
MIN_RATIO = 1.5
"""Smallest ratio of the numbers of files of two kinds that suggests another rate: 15 Hz beside 10."""
OPEN_UNIT = (
    "point times: from 0 to 1, which may be seconds or shares of a sweep; --time-unit states them: s, or the seconds "
    "of a sweep, such as 0.1"
)
"""Remark on times whose unit a motion will need."""
NUMBERS = re.compile("([0-9]+)")
"""The numbers in a name."""
REFERENCE_FRAME = "--reference-frame"
"""Option that states the axes of the camera's frame in the reference."""


@dataclass(frozen=True)
class FilePatterns:
    """Patterns and files of a user's own data. A pattern starts in the working folder; `**` matches any folders."""

    points: str
    """Pattern of the clouds."""
    camera_info: Path
    """File of the intrinsics."""
    max_gap_s: float
    """Largest time between a cloud and its partner, in seconds."""
    image_labels: str | None = None
    """Pattern of the label images."""
    point_labels: str | None = None
    """Pattern of the point labels."""
    images: str | None = None
    """Pattern of the images."""
    camera: str | None = None
    """Name of a camera in a Kalibr camchain; None for the only one."""
    model: str | None = None
    """Camera model, if the file of the intrinsics names none or a wrong one."""
    is_resized: bool = False
    """Whether images were resized after the camera was calibrated, so that K is converted to their size."""
    reference: Path | None = None
    """File of a transform to compare with."""
    reference_direction: Direction | None = None
    """Direction of a matrix whose file does not state it."""
    reference_frame: CameraFrame | None = None
    """Axes of the camera's frame in the reference; None for those that the file states, or optical ones."""
    synchronization: Synchronization = "unknown"
    """What ties the images to the moments of the clouds."""
    max_points: int = MAX_POINTS
    """Largest number of points of a cloud that is read."""
    point_columns: tuple[PointColumn, ...] | None = None
    """Columns of `.bin` clouds; None for the usual ones, if the numbers are in them."""
    point_type: PointType = "f4"
    """Type of the numbers of `.bin` clouds."""
    time_unit: NamedUnit | float | None = None
    """Unit of point times, or its length in seconds; None for the one that the first cloud suggests."""
    lidar: Mapping[str, Any] | None = None
    """The `lidar:` block of the drive, which no file states."""
    keeps_all: bool = False
    """Whether clouds without an image or a label image are kept, too."""


@dataclass(frozen=True)
class Partners:
    """Files of one kind that are paired with clouds."""

    of_cloud: dict[Path, Path] = field(default_factory=dict)
    """The file of each cloud that has one."""
    stamps_s: dict[Path, float] = field(default_factory=dict)
    """Times of the files whose names hold one, in seconds."""
    remarks: tuple[str, ...] = ()
    """Sentences that the user should read."""


class PairedFiles(NamedTuple):
    """Clouds that are used, and the files that go with them."""

    clouds: list[Path]
    points_stamps_s: dict[Path, float]
    """Times of all clouds whose names hold one, in seconds, whether they are used or not."""
    point_labels: Partners
    image_labels: Partners
    images: Partners

    @property
    def image_partners(self) -> Partners:
        """The files by which clouds are paired with images."""
        return self.image_labels if self.image_labels.of_cloud else self.images

    def frame(self, cloud: Path, *, has_labels: bool) -> SourceFrame:
        """Make the frame of a cloud; without one of two partners, it is a sweep without an image."""
        partner = self.image_partners.of_cloud.get(cloud)
        return SourceFrame(
            name=stem(cloud),
            points=cloud,
            point_labels=self.point_labels.of_cloud.get(cloud),
            image_labels=None if partner is None else self.image_labels.of_cloud.get(cloud),
            image=None if partner is None else self.images.of_cloud.get(cloud),
            points_stamp=self.points_stamps_s.get(cloud),
            image_stamp=None if partner is None else self.image_partners.stamps_s.get(partner),
            cloud_has_labels=has_labels,
        )


def read(patterns: FilePatterns) -> Recording:
    """Pair the files and read the intrinsics.

    Raises:
        InputError: a pattern matches nothing or a file of an unknown format, nothing can be paired, no cloud has all
            its files, or a file is wrong.
    """
    camera, paired = _camera(patterns), _pair(patterns)
    first_path = paired.clouds[0]
    lidar = None if patterns.lidar is None else Lidar.model_validate(dict(patterns.lidar))
    form = PointForm(
        patterns.point_columns,
        patterns.point_type,
        patterns.time_unit,
        None if lidar is None else lidar.own_values,
    )
    (first,) = read_point_clouds([(first_path, None)], patterns.max_points, form)
    columns = column_doubts(first_path, form, first, patterns.max_points)
    form, unit_remarks = _with_time_unit(form, first.time, list(paired.points_stamps_s.values()))
    has_labels = not paired.point_labels.of_cloud and first.labels is not None
    own_labels = (
        (f"point labels: from the clouds themselves, such as {first_path.name}",) if has_labels else ()
    )
    frames = [paired.frame(cloud, has_labels=has_labels) for cloud in paired.clouds]
    T_camera_lidar, doubts = (
        (None, ()) if patterns.reference is None else _reference(patterns, patterns.reference)
    )
    return Recording(
        camera=camera,
        frames=sorted(frames, key=lambda frame: (frame.points_stamp or 0.0, _by_numbers(frame.name))),
        T_camera_lidar=T_camera_lidar,
        lidar=patterns.lidar,
        synchronization=patterns.synchronization,
        point_form=form,
        remarks=(
            *doubts,
            *columns,
            *own_labels,
            *unit_remarks,
            *paired.point_labels.remarks,
            *paired.image_labels.remarks,
            *paired.images.remarks,
        ),
        read=(patterns.camera_info, *([drive_file(patterns.reference)] if patterns.reference else [])),
        labels_by="GLOB",
    )


def _pair(patterns: FilePatterns) -> PairedFiles:
    """Find the files that go with each cloud, and the clouds that have what they need."""
    clouds = _find("--points", patterns.points)
    point_labels, image_labels, images = (
        _partners(clouds, option, pattern, patterns.max_gap_s)
        for option, pattern in (
            ("--point-labels", patterns.point_labels),
            ("--image-labels", patterns.image_labels),
            ("--images", patterns.images),
        )
    )
    paired = PairedFiles(clouds, stamps_s(clouds), point_labels, image_labels, images)
    image_partners = paired.image_partners
    needed = [partners.of_cloud for partners in (point_labels, image_partners) if partners.of_cloud]
    usable = [cloud for cloud in clouds if all(cloud in files for files in needed)]
    if not usable:
        option = "--image-labels" if image_labels.of_cloud else "--images"
        raise InputError(
            f"--points: found {counted(len(clouds), 'cloud')}, {len(point_labels.of_cloud):,} with a file of "
            f"--point-labels, {len(image_partners.of_cloud):,} with one of {option}, none with both, "
            "needed at least one"
        )
    if patterns.keeps_all:
        usable = [cloud for cloud in clouds if not point_labels.of_cloud or cloud in point_labels.of_cloud]
    return paired._replace(clouds=usable)


def _camera(patterns: FilePatterns) -> dict[str, Any]:
    """Read the camera, and compare it with the size of the first image, to which it is converted on request."""
    option = "--images" if patterns.images else "--image-labels"
    pattern = patterns.images or patterns.image_labels
    image = None if pattern is None else _find(option, pattern)[0]
    size = None if image is None else lambda: read_size(image)
    camera = read_intrinsics(patterns.camera_info, patterns.camera, patterns.model, size)
    if image is None or size is None or not image.name.lower().endswith(IMAGE_SUFFIXES):
        if patterns.is_resized:
            raise InputError("--resized: found no images, expected some by --images")
        return camera
    if patterns.is_resized:
        return resized(camera, size())
    if problem := size_problem(camera, size(), f"{patterns.camera_info} states"):
        raise InputError(f"{image}: {problem}")
    return camera


def _with_time_unit(
    form: PointForm, times_s: Numbers | None, stamps: Sequence[float]
) -> tuple[PointForm, tuple[str, ...]]:
    """State the unit of point times where the time between clouds shows it, and say so."""
    if times_s is None or form.time_unit is not None:
        return form, ()
    unit = deduced_unit(times_s, float(np.median(np.diff(sorted(stamps)))) if len(stamps) > 1 else None)
    if unit is None:
        is_open = may_be_shares(float(times_s.min()), float(times_s.max()))
        return form, (OPEN_UNIT,) if is_open else ()
    meaning = unit if isinstance(unit, str) else f"shares of a turn of {unit:g} s"
    remark = f"point times: taken as {meaning}, in which a sweep lasts until the next one; --time-unit states another"
    return form._replace(time_unit=unit), (remark,)


def _by_numbers(name: str) -> tuple[list[str | int], str]:
    """Make a key that sorts names by the numbers in them: sweep_9 comes before sweep_10."""
    return [int(part) if part.isdecimal() else part for part in NUMBERS.split(name)], name


def _find(option: str, pattern: str) -> list[Path]:
    names = glob.glob(pattern, recursive=True)  # noqa: PTH207 - Path.glob takes no absolute pattern
    paths = [path for path in map(Path, sorted(names, key=_by_numbers)) if path.is_file()]
    suffixes = SUFFIXES[option]
    if not paths:
        problem = "found no matching file, needed at least one; quote the pattern"
        if is_folder(folder := Path(pattern)):
            files = [path.suffix for path in sorted(folder.iterdir()) if path.suffix in suffixes]
            example = folder / f"*{files[0] if files else suffixes[0]}"
            problem = f"is a folder, expected a pattern of its files, such as '{example}'"
        raise InputError(f"{option}: {pattern}: {problem}")
    for path in paths:
        if not path.name.lower().endswith(suffixes):
            suffix = f"found suffix {path.suffix!r}" if path.suffix else "found no suffix"
            if not path.name.lower().endswith((*chain(*SUFFIXES.values()),)):
                suffix = f"found {kind}" if (kind := kind_of_data(path)) else suffix
            raise InputError(
                f"{option}: {path}: {suffix}, expected {', '.join(suffixes[:-1])} or {suffixes[-1]}"
            )
    return paths


def _partners(clouds: list[Path], option: str, pattern: str | None, max_gap_s: float) -> Partners:
    """Pair one kind of files with the clouds, and count the unpaired ones."""
    if pattern is None:
        return Partners()
    files = _find(option, pattern)
    partners = pairs(clouds, files, max_gap_s)
    rule = f"by time, within {max_gap_s} s" if by_time(clouds, files) else "by name"
    first = next(iter(partners.items()), None)
    is_by_number = rule == "by name" and first is not None and stem(first[0]) != stem(first[1])
    if is_by_number and first is not None:
        rule = f"by the numbers in their names, such as {first[0].name} with {first[1].name}"
    if not partners:
        raise InputError(
            f"{option}: found no partner, {rule}, for any of {counted(len(clouds), 'cloud')} "
            f"(such as {clouds[0].name}) among {counted(len(files), 'file')} (such as {files[0].name})"
        )
    num_unpaired = len(clouds) - len(partners), len(files) - len(partners)
    unpaired = f"{counted(num_unpaired[0], 'cloud')}, {counted(num_unpaired[1], 'file')}"
    counts = f"{option}: {counted(len(partners), 'pair')} {rule}; unpaired: {unpaired}"
    remarks = [counts] if any(num_unpaired) or is_by_number else []
    are_numbers = is_by_number or (rule == "by name" and all(stem(cloud).isdecimal() for cloud in clouds))
    if are_numbers and _have_other_rate(clouds, files, partners):
        remarks.append(
            f"{option}: {counted(len(clouds), 'cloud')} and {counted(len(files), 'file')} are numbered from the same "
            "start: if they were recorded together, their rates differ, and those of one number are of different "
            "moments; names with their times pair them"
        )
    return Partners(partners, stamps_s(files), tuple(remarks))


def _have_other_rate(clouds: list[Path], files: list[Path], partners: dict[Path, Path]) -> bool:
    """Whether all clouds have partners until one side ends, long before the other: lost files leave gaps between."""
    fewer, more = sorted((len(clouds), len(files)))
    first_clouds, first_files = (
        {*sorted(paths, key=lambda path: (len(path.name), path.name))[:fewer]} for paths in (clouds, files)
    )
    is_prefix = first_clouds == {*partners} and first_files == {*partners.values()}
    return is_prefix and more >= MIN_RATIO * fewer


def _reference(patterns: FilePatterns, path: Path) -> tuple[Pose, tuple[str, ...]]:
    """Read the transform to compare with, and doubts about its frame."""
    direction, axes = patterns.reference_direction, patterns.reference_frame
    names = {"direction": REFERENCE_DIRECTION, "frame": REFERENCE_FRAME}
    with np.errstate(all="ignore"):
        extrinsic = read_extrinsic(
            path, None, FormatOptions(direction, axes, names=names), ignores_unasked=True
        )
        T = rigid(f"{path}", extrinsic.T_camera_lidar, MAX_TRANSLATION_M)
    if "frame" in extrinsic.asks or axes == "optical":
        return T, ()
    if axes == "body":
        return inverse(T_BODY_OPTICAL) @ T, ()
    return T, tuple(body_frame_doubts(f"the camera's frame in {path}", T, REFERENCE_FRAME))
