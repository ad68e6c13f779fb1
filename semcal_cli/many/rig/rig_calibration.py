"""Calibration of a rig: the calibrations of its cameras, and what follows from them for each pair of sensors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.geometry.poses import inverse
from semcal_cli.many.rig.adjustment_document import Adjustment, ComparedConstraint, LoopClosure
from semcal_cli.many.rig.further_lidar import LidarCalibration, first_cameras
from semcal_cli.many.rig.matched_images import ComparedImages, MatchedImages
from semcal_cli.many.rig.rig_document import Rig
from semcal_cli.many.rig.rig_pair import Reference, RigPair, make_pair
from semcal_cli.result.calibration_document import CalibrationDocument, Status
from semcal_cli.result.provenance import versions

WORST_FIRST: tuple[Status, ...] = ("not_trusted", "not_assessed", "trusted")


@dataclass(frozen=True)
class RigCalibration:
    """Calibrations of the cameras of a rig, of its pairs of cameras, and of its further LiDARs."""

    cameras: Mapping[str, CalibrationDocument]
    """Calibration of each camera that has one, with each LiDAR that it sees, by the names of the results."""
    failures: Mapping[str, str]
    """Error of each that has no calibration."""
    pairs: tuple[RigPair, ...]
    """Transform between each two cameras that see the first LiDAR."""
    num_sweeps: int
    """Number of different clouds that were read."""
    adjustment: Adjustment | None = None
    """What all sensors and the ties between them say together; None without constraints and further LiDARs."""
    lidars: tuple[LidarCalibration, ...] = ()
    """The further LiDARs."""
    images: tuple[ComparedImages, ...] | None = None
    """What overlapping images show of two cameras; None unless the rig asks for that."""
    image_notes: tuple[str, ...] = ()
    """Images that could not be matched."""

    @property
    def first_cameras(self) -> dict[str, CalibrationDocument]:
        """Calibration of each camera with the first LiDAR that has one."""
        further = self.further_views
        return {name: calibration for name, calibration in self.cameras.items() if name not in further}

    @property
    def own_cameras(self) -> dict[str, RigPair]:
        """Transform from the first LiDAR to each camera that has no calibration with it."""
        return {pair.a: pair for lidar in self.lidars for pair in lidar.own_cameras}

    @property
    def further_views(self) -> dict[str, tuple[str, str]]:
        """Camera and LiDAR of each result with a further LiDAR."""
        return {view: (camera, lidar.name) for lidar in self.lidars for camera, view in lidar.views.items()}

    @property
    def contradictions(self) -> tuple[ComparedConstraint, ...]:
        """Constraints and measurements that the others contradict."""
        return () if self.adjustment is None else self.adjustment.contradictions

    @property
    def contradicted_images(self) -> tuple[ComparedImages, ...]:
        """What images show of two cameras whose calibrations contradict it, though nothing else speaks against them."""
        return tuple(
            shown
            for shown in self.images or ()
            if shown.is_contradicted
            and all(self.cameras[name].is_believed for name in (shown.to, shown.source))
        )

    @property
    def loops(self) -> tuple[LoopClosure, ...]:
        """Closures of the loops of a rig of several LiDARs."""
        return () if self.adjustment is None or not self.lidars else self.adjustment.loops

    @property
    def status(self) -> str:
        """The worst status of all cameras and LiDARs: `failed` without a calibration; `not_trusted` by a wrong tie."""
        if self.failures:
            return "failed"
        statuses = [calibration.status for calibration in self.cameras.values()]
        statuses += [lidar.status for lidar in self.lidars]
        is_contradicted = self.contradictions or self.contradicted_images
        return min([*statuses, *(["not_trusted"] if is_contradicted else [])], key=WORST_FIRST.index)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the transforms between sensors: wrong ties, and LiDARs that are not known well."""
        contradictions = (
            *(constraint.reason for constraint in self.contradictions),
            *(shown.reason for shown in self.contradicted_images),
        )
        lidar_reasons = ((lidar.name, reason) for lidar in self.lidars for reason in lidar.reasons)
        return contradictions + tuple(
            f"{name}: {reason}" for name, reason in lidar_reasons if reason not in contradictions
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """Ties that are wrong, then findings and errors of all cameras and LiDARs, each preceded by its name."""
        return (
            *self.doubts,
            *(f"{name}: {reason}" for name, reason in self.failures.items()),
            *(
                f"{name}: {reason}"
                for name, calibration in self.cameras.items()
                for reason in calibration.reasons
            ),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that the user should read and that do not affect the verdict."""
        notes = []
        for pair in (*self.pairs, *(lidar.pair for lidar in self.lidars if lidar.pair is not None)):
            if pair.is_explained is False and pair.error is not None and pair.reference is not None:
                distance = f"{pair.error.camera_center_cm:.2f} cm and {pair.error.rotation_deg:.3f} deg"
                notes.append(
                    f"T_{pair.a}_{pair.b} is {distance} from {pair.reference.source}, more than chance explains"
                )
        skipped = () if self.adjustment is None else self.adjustment.skipped
        notes += [
            f"the constraint of {to} and {source} was not used: one has no trusted pose"
            for to, source in skipped
        ]
        notes += [f"{lidar.name}: {note}" for lidar in self.lidars for note in lidar.notes]
        notes += self.image_notes
        if self.images == ():
            notes.append("match_images found no two cameras whose images show enough of the same features")
        return tuple(notes)


def combine(
    rig: Rig,
    drives: Mapping[str, Drive],
    cameras: Mapping[str, CalibrationDocument],
    failures: Mapping[str, str],
    num_sweeps: int,
    adjustment: Adjustment | None = None,
    lidars: tuple[LidarCalibration, ...] = (),
    images: Iterable[MatchedImages] | None = None,
    image_notes: tuple[str, ...] = (),
) -> RigCalibration:
    """Combine the calibrations of a rig's cameras, and compare each pair with the reference of the rig or the drives.

    Args:
        rig: The rig.
        drives: Drive of each camera with each LiDAR, by the names of the results.
        cameras: Calibration of each that has one.
        failures: Error of each that has none.
        num_sweeps: Number of different clouds that were read.
        adjustment: What all sensors and ties say together, which the calibrations follow already.
        lidars: The further LiDARs.
        images: What overlapping images show of two cameras, if the rig asks for that.
        image_notes: Images that could not be matched.
    """
    poses = {name: calibration.pose for name, calibration in cameras.items()}
    compared = None if images is None else tuple(ComparedImages.beside(shown, poses) for shown in images)
    pairs, doubted = [], set[str]() if adjustment is None else {*adjustment.doubted}
    doubted |= {
        name
        for shown in compared or ()
        if shown.is_contradicted and all(cameras[end].is_believed for end in (shown.to, shown.source))
        for name in (shown.to, shown.source)
    }
    for a, b in combinations(first_cameras(rig, cameras), 2):
        reference, T_a, T_b = None, drives[a].T_camera_lidar, drives[b].T_camera_lidar
        if (T_a_b := rig.reference(a, b)) is not None:
            reference = Reference(T_a_b, rig.path.name)
        elif T_a is not None and T_b is not None:
            reference = Reference(np.array(T_a) @ inverse(np.array(T_b)), "T_camera_lidar of both drives")
        pair_covariance = None if adjustment is None else adjustment.covariance_of(a, b)
        pair = make_pair(a, cameras[a], b, cameras[b], reference, pair_covariance)
        is_doubted = pair.is_doubted or not {a, b}.isdisjoint(doubted)
        pairs.append(replace(pair, is_doubted=is_doubted))
    return RigCalibration(
        cameras, failures, tuple(pairs), num_sweeps, adjustment, lidars, compared, image_notes
    )


def describe_rig(
    rig: RigCalibration, files: Mapping[str, str], source: str, hashes: Mapping[str, str]
) -> dict[str, Any]:
    """Make the document of a rig's calibration.

    Args:
        rig: Calibrations of the rig.
        files: File of each camera's calibration, relative to this document.
        source: The rig.yaml, relative to this document.
        hashes: SHA-256 of the rig.yaml, of the drive.yaml of each camera, and of what images were matched with.
    """
    views = {name: _describe_camera(name, rig, files) for name in (*rig.failures, *rig.cameras)}
    lidars = {lidar.name: _describe_lidar(lidar, views) for lidar in rig.lidars}
    return {
        "semcal_rig_calibration": 1,
        "status": rig.status,
        "reasons": list(rig.reasons),
        "notes": list(rig.notes),
        "cameras": {name: view for name, view in views.items() if name not in rig.further_views},
        "pairs": [pair.describe() for pair in rig.pairs],
        **({} if rig.images is None else {"images": [shown.model_dump() for shown in rig.images]}),
        **({"image_notes": list(rig.image_notes)} if rig.image_notes else {}),
        **({"lidars": lidars} if lidars else {}),
        **(
            {} if rig.adjustment is None else {"adjustment": rig.adjustment.describe(with_loops=bool(lidars))}
        ),
        "num_sweeps": rig.num_sweeps,
        "input": {"rig": source, "sha256": dict(hashes)},
        "versions": versions(),
    }


def _describe_camera(name: str, rig: RigCalibration, files: Mapping[str, str]) -> dict[str, Any]:
    """Make the entry of a camera with a LiDAR, by the name of its result."""
    if name in rig.failures:
        return {"status": "failed", "reasons": [rig.failures[name]]}
    calibration = rig.cameras[name]
    return {
        "status": calibration.status,
        "reasons": list(calibration.reasons),
        "calibration": files[name],
        "T_camera_lidar": calibration.rows_camera_lidar,
    }


def _describe_lidar(lidar: LidarCalibration, views: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Make the entry of a further LiDAR, given those of all cameras by the names of their results."""
    return {
        "status": lidar.status,
        "reasons": list(lidar.reasons),
        "notes": list(lidar.notes),
        "pair": None if lidar.pair is None else lidar.pair.describe(),
        "cameras": {camera: views[view] for camera, view in lidar.views.items()},
        "own_cameras": [pair.describe() for pair in lidar.own_cameras],
        "registration": None if lidar.registration is None else lidar.registration.model_dump(),
    }
