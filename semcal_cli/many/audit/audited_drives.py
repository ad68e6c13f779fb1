"""What an audit found: drives by camera, in the order of recording, and the axes that are off since some drive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.errors import counted, listed
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.many.batch.tasks import Outcome
from semcal_cli.many.chronology import Order, in_order
from semcal_cli.pipeline.verdict import OVERALL, VERDICTS, AxisVerdict, Verdict, figures, together
from semcal_cli.pipeline.verification import Verification
from semcal_cli.result.provenance import camera_hash

NOT_VERIFIED = "not verified"
"""Word for a drive without a verdict."""
PARTS = ("camera centre", "rotation")
"""Names of what is judged axis by axis and in total."""
AXES_OF = {f"{part}{OVERALL}": tuple(f"{part} {axis}" for axis in "xyz") for part in PARTS}
"""Names of the checks of the axes of each total."""
NEAR_DEG, NEAR_M = 15.0, 0.3
"""Largest rotation and distance between the delivered poses of a camera without a name: both cameras of a stereo pair
are farther apart, and no calibration is that wrong for long."""


@dataclass(frozen=True, eq=False)
class AuditedDrive:
    """A drive of one camera, and how far the calibration that it states is off."""

    outcome: Outcome
    verification: Verification | None
    """None if the drive could not be verified."""

    @property
    def name(self) -> str:
        """Name of the drive, as the user wrote it."""
        return self.outcome.drive

    @property
    def stamp(self) -> float | None:
        """Stamp of the first frame in seconds; None if it has none."""
        return self.outcome.stamp

    @property
    def verdict(self) -> Verdict:
        """Verdict on the calibration; nothing is known of a drive that could not be verified."""
        return "inconclusive" if self.verification is None else self.verification.verdict

    @property
    def word(self) -> str:
        """The verdict in a word."""
        return NOT_VERIFIED if self.verification is None else self.verdict

    @property
    def has_figures(self) -> bool:
        """Whether its offsets are judged, each on its own; a reason stands in their place otherwise."""
        return self.verification is not None and not self.verification.is_reasoned

    @property
    def judged(self) -> dict[str, AxisVerdict]:
        """Checks that pass or fail, by name."""
        checks = self.verification.checks if self.verification is not None and self.has_figures else ()
        return {check.name: check for check in checks if check.verdict != "inconclusive"}


@dataclass(frozen=True)
class Departure:
    """An axis along or about which a delivered calibration is off, in one drive or more."""

    axis: str
    """Name of the check."""
    drives: tuple[AuditedDrive, ...]
    """Drives of the camera in which the axis passes or fails, in order."""

    @cached_property
    def failing(self) -> tuple[AuditedDrive, ...]:
        """Drives in which it is off."""
        return tuple(drive for drive in self.drives if drive.judged[self.axis].verdict == "fail")

    @property
    def is_over(self) -> bool:
        """Whether it holds again in the last drive that shows it."""
        return self.failing[-1] is not self.drives[-1]

    @property
    def since(self) -> AuditedDrive:
        """First drive from which on it is off in all drives that show it; the first of all if it holds again."""
        if self.is_over:
            return self.failing[0]
        after = 1 + max((i for i, drive in enumerate(self.drives) if drive not in self.failing), default=-1)
        return self.drives[after]

    @property
    def before(self) -> AuditedDrive | None:
        """Last drive before `since` in which it holds; None if there is none."""
        index = self.drives.index(self.since)
        return self.drives[index - 1] if index else None

    @property
    def sentence(self) -> str:
        """The axis, since when it is off, and by how much there."""
        off = f"by {figures(self.since.judged[self.axis])}"
        where = f"in {counted(len(self.failing), 'drive')} of the {len(self.drives)} that show it"
        name = self.axis.removesuffix(OVERALL)
        if self.is_over:
            return f"{name} is off {where}, first in {self.since.name} {off}, and holds again in {self.drives[-1].name}"
        if self.before is None:
            first = f"{where}, first in" if len(self.drives) > 1 else "in"
            return f"{name} is off {first} {self.since.name} {off}"
        since = f"{self.before.name} and is off since {self.since.name}, there {off}"
        num_earlier = sum(drive in self.failing for drive in self.drives[: self.drives.index(self.since)])
        if num_earlier:
            return f"{name} holds in {since}; it was also off in {counted(num_earlier, 'earlier drive')}"
        return f"{name} holds until {since}"

    @property
    def document(self) -> dict[str, Any]:
        """The departure as JSON."""
        return {
            "axis": self.axis,
            "since": self.since.name,
            "since_stamp": self.since.stamp,
            "holds_until": None if self.before is None else self.before.name,
            "is_over": self.is_over,
            "num_failing": len(self.failing),
            "num_judged": len(self.drives),
        }


@dataclass(frozen=True)
class AuditedCamera:
    """The drives of one camera."""

    name: str
    drives: tuple[AuditedDrive, ...]
    """In the order of their stamps or, where these cannot be compared, of their names."""
    order: Order

    @property
    def verdict(self) -> Verdict:
        """Verdict on all drives."""
        return together(drive.verdict for drive in self.drives)

    @cached_property
    def departures(self) -> tuple[Departure, ...]:
        """Axes that are off, and totals that are off in a drive in which none of their axes is."""
        by_axis: dict[str, list[AuditedDrive]] = {}
        for drive in self.drives:
            for axis in drive.judged:
                by_axis.setdefault(axis, []).append(drive)
        departures = {axis: Departure(axis, tuple(drives)) for axis, drives in by_axis.items()}
        failing = {axis: set(departure.failing) for axis, departure in departures.items()}
        for total, axes in AXES_OF.items():
            if failing.get(total, set()) <= set().union(*(failing.get(axis, ()) for axis in axes)):
                failing[total] = set()
        return tuple(departure for axis, departure in departures.items() if failing[axis])

    @property
    def sentences(self) -> list[str]:
        """What is off and since when; or else in how many drives the calibration is shown to hold."""
        if self.departures:
            return [departure.sentence for departure in self.departures]
        verdicts = [drive.verdict for drive in self.drives]
        num_failed = sum(drive.verification is None for drive in self.drives)
        num_open = verdicts.count("inconclusive") - num_failed
        num_holding = verdicts.count("pass")
        words = [
            f"holds in {num_holding} of {counted(len(verdicts), 'drive')}" if num_holding else "",
            f"{counted(num_open, 'drive')} cannot show whether it holds" if num_open else "",
            f"{counted(num_failed, 'drive')} could not be verified" if num_failed else "",
        ]
        return ["; ".join(filter(None, words))]

    @property
    def document(self) -> dict[str, Any]:
        """The camera as JSON."""
        return {
            "camera": self.name,
            "verdict": self.verdict,
            "order": self.order,
            "departures": [departure.document for departure in self.departures],
            "drives": [
                {
                    "drive": drive.name,
                    "stamp": drive.stamp,
                    **(
                        {"verdict": drive.word} if drive.verification is None else drive.verification.document
                    ),
                    "reasons": drive.outcome.reasons,
                }
                for drive in self.drives
            ],
        }


@dataclass(frozen=True)
class Audit:
    """All cameras of a data set, worst first."""

    cameras: tuple[AuditedCamera, ...]

    @property
    def drives(self) -> list[AuditedDrive]:
        """All drives."""
        return [drive for camera in self.cameras for drive in camera.drives]

    @property
    def verdict(self) -> Verdict:
        """Verdict on all cameras; a drive that could not be verified fails, as in a batch."""
        is_failed = any(drive.verification is None for drive in self.drives)
        return together([*(camera.verdict for camera in self.cameras), "fail" if is_failed else "pass"])

    @property
    def title(self) -> str:
        """The verdict in words."""
        num, of_drives = len(self.cameras), [drive.verdict for drive in self.drives]
        num_off = sum(camera.verdict == "fail" for camera in self.cameras)
        num_failed = sum(drive.verification is None for drive in self.drives)
        if num_off:
            verb = "is" if num_off == 1 else "are"
            return f"the calibration of {num_off} of {counted(num, 'camera')} {verb} off"
        if num_failed:
            return f"{num_failed} of {counted(len(of_drives), 'drive')} could not be verified"
        num_holding = of_drives.count("pass")
        if not num_holding:
            return "no drive shows whether the delivered calibration holds"
        holding = f"{num_holding} of {counted(len(of_drives), 'drive')}"
        return f"the delivered calibration holds in {holding}, and is off in none"

    @property
    def document(self) -> dict[str, Any]:
        """The audit as JSON."""
        return {
            "verdict": self.verdict,
            "title": self.title,
            "cameras": [camera.document for camera in self.cameras],
        }

    @property
    def groups(self) -> dict[str, str]:
        """Names of cameras by what is known of them."""
        words: dict[Verdict, str] = {
            "fail": "Off",
            "inconclusive": "Not shown to hold in all drives",
            "pass": "Hold in all drives",
        }
        named = {
            text: [camera.name for camera in self.cameras if camera.verdict == verdict]
            for verdict, text in words.items()
        }
        return {text: listed(names) for text, names in named.items() if names}


class _Camera(NamedTuple):
    """What identifies the camera of a drive."""

    name: str
    """Its name; empty if neither a rig nor the drive states one."""
    intrinsics: str = ""
    """Hash of its intrinsics; empty if the drive cannot be read."""
    T_camera_lidar: Pose | None = None
    """(4, 4) where it is delivered to be; None if that is not stated."""

    def is_same(self, other: _Camera) -> bool:
        """Return whether two drives have one camera; images that were rectified together share their intrinsics."""
        if self.name or other.name:
            return self.name == other.name
        if not self.intrinsics or self.intrinsics != other.intrinsics:
            return False
        if self.T_camera_lidar is None or other.T_camera_lidar is None:
            return True
        return compare_poses(self.T_camera_lidar, other.T_camera_lidar).is_within(NEAR_DEG, NEAR_M)


def group_by_camera(
    drives: Iterable[AuditedDrive], documents: Mapping[str, Drive], names: Mapping[str, str]
) -> Audit:
    """Group drives by camera.

    Drives belong to one camera if a rig or their `frame_ids` name it alike, or else if they state the same intrinsics
    and nearly the same pose. A drive without a pose belongs to the only camera of its intrinsics, if there is one, or
    else is a camera of its own.

    Args:
        drives: The drives.
        documents: What is written in each drive that could be read, by its name.
        names: Name of the camera of each drive of a rig, by the name of the drive.
    """
    groups: list[tuple[_Camera, list[AuditedDrive]]] = []
    of_drives = [
        (_camera_of(documents.get(drive.name), names.get(drive.name, "")), drive) for drive in drives
    ]
    for camera, drive in sorted(of_drives, key=lambda of_drive: of_drive[0].T_camera_lidar is None):
        fitting = [members for other, members in groups if camera.is_same(other)]
        if len(fitting) == 1 or (fitting and camera.T_camera_lidar is not None):
            fitting[0].append(drive)
        else:
            groups.append((camera, [drive]))
    cameras = []
    for camera, members in groups:
        ordered, order = in_order(members)
        cameras.append(AuditedCamera(camera.name or f"camera of {ordered[0].name}", tuple(ordered), order))
    return Audit(tuple(sorted(cameras, key=lambda camera: (VERDICTS.index(camera.verdict), camera.name))))


def _camera_of(document: Drive | None, name: str) -> _Camera:
    """Identify the camera of a drive by the name that a rig gives it, or else by what the drive states."""
    if name or document is None:
        return _Camera(name)
    frame_id = document.frame_ids.camera if document.frame_ids is not None else None
    T = None if document.T_camera_lidar is None else np.array(document.T_camera_lidar)
    return _Camera(frame_id or "", camera_hash(document.camera), T)
