"""Rigs of two LiDARs: how well cameras, registration and both place them, and whether a wrong measurement is named.

    python tests/benchmarks/rig_lidars.py --seeds 12

Synthetic rigs, each with another world and other mountings, 20 % wrong labels on both sides. Each camera is calibrated
with each LiDAR, and the sweeps of both are registered from where the cameras place them. Prints a Markdown table: the
errors of T_lidar_lidar by each, how often 95 % intervals hold the truth, and how often a measurement of a further LiDAR
that is two degrees off is the one that is named. K is exact, unless `--k-sigmas` draws that of each camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import SEMCAL, run_process, script, table

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import K_ENTRIES, default_sigma
from semcal_cli.drive.document import read_drive
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import pose_at
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.further_lidar import first_cameras, measure_lidars
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, Rig, read_rig
from semcal_cli.many.rig.rig_pair import from_first_lidar
from semcal_cli.many.rig.ties import Tie
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration
from semcal_cli.synthetic.synthesis import synthesize_rig

WRONG_DEG = 2.0
LIDAR = "lidar_1"
WAYS = {
    "cameras": ("calibration",),
    "registration": ("registration",),
    "both": ("calibration", "registration"),
}
"""Kinds of ties that place the LiDAR."""


@dataclass
class Errors:
    """Errors of T_lidar_lidar over the rigs."""

    rotation_deg: list[float] = field(default_factory=list)
    distance_cm: list[float] = field(default_factory=list)
    is_held: list[float] = field(default_factory=list)
    """Share of the axes whose 95 % interval holds the truth."""
    num_named: int = 0
    """Number of rigs whose wrong measurement is named, and no other."""

    def row(self, name: str, num_rigs: int) -> tuple[str, ...]:
        """Make a row of the table."""
        if not self.rotation_deg:
            return name, f"0 of {num_rigs}", *("-" * 6)
        return (
            name,
            f"{len(self.rotation_deg)} of {num_rigs}",
            f"{np.median(self.rotation_deg):.4f}",
            f"{max(self.rotation_deg):.4f}",
            f"{np.median(self.distance_cm):.3f}",
            f"{max(self.distance_cm):.3f}",
            f"{np.mean(self.is_held):.1%}",
            f"{self.num_named} of {num_rigs}" if name == "both" else "-",
        )


def main(
    *,
    seeds: int = 12,
    first_seed: int = 64_000,
    cameras: int = 2,
    frames: int = 6,
    width: int = 1280,
    k_sigmas: float = 0.0,
) -> Iterator[str]:
    """Calibrate each rig, and place its second LiDAR."""
    config = SynthConfig(num_frames=frames, width=width, height=width * 9 // 16, label_noise=0.2)
    errors = {name: Errors() for name in WAYS}
    for seed in range(first_seed, first_seed + seeds):
        with TemporaryDirectory() as folder:
            rig, calibrations, ties = _measure(replace(config, seed=seed), cameras, Path(folder), k_sigmas)
        truth = rig.reference(FIRST_LIDAR, LIDAR)
        assert truth is not None
        direct = first_cameras(rig, calibrations)
        for name, kinds in WAYS.items():
            _add(errors[name], direct, [tie for tie in ties if tie.kind in kinds], truth)
        errors["both"].num_named += _is_named(direct, ties, np.random.default_rng(seed))
    yield from table(
        "by | rigs | median, deg | worst | median, cm | worst | axes within 95 % intervals | wrong ones named",
        [each.row(name, seeds) for name, each in errors.items()],
    )


def _measure(
    config: SynthConfig, num_cameras: int, folder: Path, k_sigmas: float
) -> tuple[Rig, dict[str, CalibrationDocument], Sequence[Tie]]:
    """Calibrate each camera of a rig with each LiDAR alone, and register the sweeps."""
    synthesize_rig(config, num_cameras, folder, force=True, num_lidars=2)
    rig = read_rig(folder / "rig.yaml")
    if k_sigmas > 0.0:
        _spoil_k(rig, k_sigmas, np.random.default_rng(config.seed))
    registered = {
        name: lidar.model_copy(update={"is_registered": True}) for name, lidar in rig.lidars.items()
    }
    for name, view in rig.views.items():
        run_process(
            [*SEMCAL, "calibrate", str(folder / view.drive), "-o", str(folder / f"{name}.yaml"), "-q"]
        )
    files = {name: folder / f"{name}.yaml" for name in rig.views}
    calibrations = {name: read_calibration(file) for name, file in files.items() if file.exists()}
    measured = measure_lidars(rig.model_copy(update={"lidars": registered}), calibrations, rig.read_drives())
    return rig, calibrations, measured.ties


def _spoil_k(rig: Rig, sigmas: float, rng: np.random.Generator) -> None:
    """Draw the K that the drives of each camera state, which then has the default standard deviations."""
    drawn = {camera: sigmas * rng.standard_normal(len(K_ENTRIES)) for camera in rig.all_cameras}
    for view in rig.views.values():
        file = rig.path.parent / view.drive / "drive.yaml"
        document = read_document(file)
        sigma = default_sigma(read_drive(file).camera)
        for error, (name, (row, column)) in zip(drawn[view.camera], K_ENTRIES.items(), strict=True):
            document["camera"]["K"][row][column] += float(error * getattr(sigma, name))
        del document["camera"]["intrinsics_sigma"]
        write_text(document_text(document, "yaml"), file)


def _add(errors: Errors, direct: Mapping[str, CalibrationDocument], ties: Sequence[Tie], truth: Pose) -> None:
    """Add the errors of a rig, if the ties place its second LiDAR."""
    _, sensors = adjust(direct, (), ties)
    if LIDAR not in sensors:
        return
    pair = from_first_lidar(LIDAR, sensors[LIDAR], None)
    error = compare_poses(pair.T_a_b, truth)
    assert pair.uncertainty is not None
    errors.rotation_deg.append(error.rotation_deg)
    errors.distance_cm.append(error.camera_center_cm)
    errors.is_held.append(float(np.mean(np.abs(error.offsets) <= pair.uncertainty.half_widths)))


def _is_named(
    direct: Mapping[str, CalibrationDocument], ties: Sequence[Tie], rng: np.random.Generator
) -> bool:
    """Turn one of the measurements, and see whether it alone is named."""
    if not ties:
        return False
    place, axis = int(rng.integers(len(ties))), rng.standard_normal(3)
    turn = np.radians(WRONG_DEG) * axis / np.linalg.norm(axis)
    wrong = replace(ties[place], pose=pose_at(ties[place].pose, np.concatenate([np.zeros(3), turn])))
    adjustment, _ = adjust(direct, (), [wrong if index == place else tie for index, tie in enumerate(ties)])
    named = [(each.kind, each.to) for each in adjustment.contradictions]
    return named == [(wrong.kind, wrong.to)]


if __name__ == "__main__":
    script(main)
