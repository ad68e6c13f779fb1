"""Calibrations and verifications of drives with known truth, and what each states about itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from laboratory.label_errors import with_shared_errors
from laboratory.rigs import RIGS, rig_of

from semcal_cli import core
from semcal_cli.config import InitializationConfig, Limits, RefinementConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.drives import Pool, calibrate_from
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import LabelledCloud, Observations
from semcal_cli.observations.reading import read_observations, remove_speckle
from semcal_cli.pipeline import initialize
from semcal_cli.pipeline.verification import verify
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.synthetic.label_noise import with_wrong_labels

CONFIDENT_SIGMAS = 4.0
CONFIDENT_DEG, CONFIDENT_CM = 0.2, 5.0
"""A calibration is confidently wrong if its error exceeds all of these."""
WRONG_DEG, WRONG_CM = 0.3, 6.0
"""A calibration of a spoiled drive is wrong if its error exceeds one of these."""
PAIRS = (1, 2, 3, 5, 10, 20)
NOISES = (0.0, 0.1, 0.2, 0.3)
SHARED = "classes off the same way in all frames"
"""Good drives whose class borders are slightly off in every image, as a network draws them."""
SHARED_PAIRS = (5, 20)
OTHER_DRIVE = len(RIGS)
"""Offset to the seed whose drive replaces the images: the next one of the same rig."""
LIMITS = Limits(rotation_deg=0.1, translation_m=0.02)
TURNED_DEG = 0.2
MOVED_M = 0.03
AS_IT_IS, TURNED = "as it is", f"{TURNED_DEG} degrees off"
MOVED = tuple(f"{100 * MOVED_M:.0f} cm off along {axis}" for axis in "xyz")
OFFSETS = (AS_IT_IS, TURNED, *MOVED)
"""Names of the transforms to verify: turned about a random axis of the camera, or moved along one of its axes."""


@dataclass(frozen=True)
class Case:
    """One run on the drive of one seed."""

    kind: str
    """Kind of the run: `good`, `mine`, a key of `BAD` or of `spoiled.KINDS`, or `verify`."""
    seed: int
    """Seed of the drive."""
    num_pairs: int
    """Number of frames that are used."""
    noise: float
    """Fraction of wrong labels on both sides."""
    draw: int = 0
    """Number of the random draw on this drive."""


@dataclass(frozen=True)
class Outcome:
    """What a calibration or a verification states, and its true errors."""

    kind: str
    """Kind of the case; for a verification one of `OFFSETS`."""
    seed: int
    """Seed of the drive."""
    rig: str
    """Name of the rig."""
    num_pairs: int
    """Number of frames that were used."""
    noise: float
    """Fraction of wrong labels on both sides."""
    status: str = "failed"
    """Status of the calibration, `failed`, or the verdict of `verify`."""
    reasons: str = ""
    """Sentences that speak against the transform."""
    errors: tuple[float, ...] = ()
    """Errors of the camera centre in centimetres and of the rotation in degrees, along the camera's axes. Where there
    are several true poses, the nearest one counts."""
    sigmas: tuple[float, ...] = ()
    """Stated standard errors of `errors`."""
    half_widths: tuple[float, ...] = ()
    """Half widths of the stated intervals of `errors`."""
    notes: str = ""
    """Sentences that do not speak against the transform."""
    has_frame: bool | None = None
    """Whether the result names the frame at which the camera was knocked, within one; None for other kinds."""
    num_axes_inside: int | None = None
    """Number of axes of the knock that lie within the stated intervals; None without a stated knock."""
    is_told: bool | None = None
    """Whether the result says what is wrong with a spoiled drive, as its kind requires; None if it requires nothing."""
    detail: str = ""
    """Figures behind `is_told`."""

    def stating(self, calibration: CalibrationDocument, errors: tuple[float, ...]) -> Outcome:
        """Copy this with what a calibration states, and its errors (6,) in centimetres and degrees."""
        outcome = replace(
            self,
            status=calibration.status,
            reasons="; ".join(calibration.reasons),
            notes="; ".join(calibration.notes),
            errors=errors,
        )
        if (stated := calibration.uncertainty) is None:
            return outcome
        sigmas = in_cm(stated.sigma_camera_center_m, stated.sigma_rotation_deg)
        halves = in_cm(stated.half_width_95_camera_center_m, stated.half_width_95_rotation_deg)
        return replace(outcome, sigmas=sigmas, half_widths=halves)

    def is_trusted(self) -> bool:
        """Whether the calibration trusts its pose."""
        return self.status == "trusted"

    def is_confidently_wrong(self) -> bool:
        """Whether a trusted pose is off by more than four standard errors, 0.2 degrees and 5 cm."""
        if not self.is_trusted():
            return False
        pairs = zip(self.errors, self.sigmas, (CONFIDENT_CM,) * 3 + (CONFIDENT_DEG,) * 3, strict=True)
        return any(abs(error) > max(CONFIDENT_SIGMAS * sigma, least) for error, sigma, least in pairs)

    def axes_inside(self) -> list[bool]:
        """Whether the error of each axis lies within the stated interval; empty without intervals."""
        pairs = zip(self.errors, self.half_widths, strict=True) if self.half_widths else ()
        return [abs(error) <= half for error, half in pairs]

    def is_outside(self) -> bool:
        """Whether the pose is trusted although the truth is outside its interval on some axis."""
        return self.is_trusted() and not (self.half_widths and all(self.axes_inside()))

    def is_outside_untold(self) -> bool:
        """Whether the pose is trusted, the truth is outside its interval, and the result does not say why."""
        return self.is_outside() and not self.is_told

    def is_missed(self) -> bool:
        """Whether the pose is trusted, wrong and outside its interval, and the result does not say why."""
        return self.is_outside_untold() and self.is_wrong()

    def is_wrong(self) -> bool:
        """Whether the pose is more than 0.3 degrees or 6 cm from the truth."""
        return distance_in_limits(self.errors) > 1.0

    def is_trusted_and_wrong(self) -> bool:
        """Whether the pose is trusted although it is wrong."""
        return self.is_trusted() and self.is_wrong()


def in_cm(camera_center_m: Sequence[float], rotation_deg: Sequence[float]) -> tuple[float, ...]:
    """Join three metres, given as centimetres, and three degrees, as `Outcome.errors` has them."""
    return *(100.0 * x for x in camera_center_m), *rotation_deg


def errors_of(T_camera_lidar: Pose, truth: Pose) -> tuple[float, ...]:
    """Compute the errors (6,) of a pose, as in `Outcome.errors`: centimetres and degrees, along the camera's axes."""
    error = compare_poses(T_camera_lidar, truth)
    return *error.camera_center_xyz_cm, *error.rotation_xyz_deg


def distance_in_limits(errors: Sequence[float]) -> float:
    """Compute the larger of the errors of position and rotation, relative to `WRONG_CM` and `WRONG_DEG`."""
    if not errors:
        return 0.0
    return float(max(np.linalg.norm(errors[:3]) / WRONG_CM, np.linalg.norm(errors[3:]) / WRONG_DEG))


Degrade = Callable[[Observations, Pose, Callable[[], Observations], np.random.Generator], Observations]
"""Makes a drive impossible to calibrate, given the true pose (4, 4) and a function that reads another drive of the
rig."""


def _one_class(
    seen: Observations, truth: Pose, other: Callable[[], Observations], rng: np.random.Generator
) -> Observations:
    """Give all points and pixels one class, except for a few wrong labels."""
    point = np.argmax(np.bincount(np.concatenate([cloud.classes for cloud in seen.clouds])))
    pixel = np.argmax(np.bincount(np.concatenate([image.classes.ravel() for image in seen.images])))

    def mostly(one: np.intp, ids: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        return np.where(rng.random(ids.shape) < 0.01, ids, one).astype(np.uint8)

    clouds = [cloud.with_classes(mostly(point, cloud.classes)) for cloud in seen.clouds]
    images = [image.with_classes(mostly(pixel, image.classes)) for image in seen.images]
    return seen.with_clouds(clouds).with_images(images)


def _other_images(
    seen: Observations, truth: Pose, other: Callable[[], Observations], rng: np.random.Generator
) -> Observations:
    """Replace the images by those of another drive, with classes matched by name."""
    another = other()
    places = {name: place for place, name in enumerate(seen.image_class_names)}
    table = np.full(256, 255, np.uint8)
    table[: len(another.image_class_names)] = [places.get(name, 255) for name in another.image_class_names]
    images = another.of_frames(range(seen.num_frames)).images
    return seen.with_images(
        own.with_classes(table[image.classes]) for own, image in zip(seen.images, images, strict=True)
    )


def _behind(
    seen: Observations, truth: Pose, other: Callable[[], Observations], rng: np.random.Generator
) -> Observations:
    """Keep only the points that the camera cannot see: behind it, or outside its image."""
    clouds = []
    for cloud in seen.clouds:
        pixels = core.project_points(core_camera(seen.camera), cloud.points, truth).pixels
        outside = ~np.isfinite(pixels).all(axis=1)
        clouds.append(LabelledCloud(cloud.points[outside], cloud.classes[outside]))
    return seen.with_clouds(clouds)


BAD: dict[str, Degrade] = {
    "one class everywhere": _one_class,
    "images of another drive": _other_images,
    "sweeps behind the camera only": _behind,
    "labels shuffled": lambda seen, truth, other, rng: seen.with_clouds(
        cloud.with_classes(rng.permutation(cloud.classes)) for cloud in seen.clouds
    ),
    "K wrong by 10 %": lambda seen, truth, other, rng: replace(
        seen, camera=seen.camera.zoomed(1.1 if rng.random() < 0.5 else 0.9)
    ),
}
"""Ways to make a drive impossible to calibrate, by name."""


def run_case(pool: Pool, case: Case) -> list[Outcome]:
    """Calibrate or verify a drive and compare with the truth."""
    rig = rig_of(case.seed)
    rng = np.random.default_rng((case.seed, case.num_pairs, case.draw, *case.kind.encode()))
    drive, truth = pool.read(rig, RIGS[rig], case.seed)
    observations = read_observations(drive)
    chosen = np.sort(rng.choice(observations.num_frames, case.num_pairs, replace=False)).tolist()
    data = LoadedDrive(drive, observations).of_frames(chosen)
    observations = with_wrong_labels(data.observations, case.noise, rng)
    if case.kind == SHARED:
        observations = with_shared_errors(observations, rng)
    if (degrade := BAD.get(case.kind)) is not None:

        def other() -> Observations:
            drive, _ = pool.read(rig, RIGS[rig], case.seed + OTHER_DRIVE)
            return with_wrong_labels(read_observations(drive), case.noise, rng)

        observations = degrade(observations, truth, other, rng)
    data = replace(data, observations=remove_speckle(observations))
    is_verified = case.kind == "verify"
    offsets = (AS_IT_IS, TURNED, MOVED[(case.seed + case.draw) % len(MOVED)])
    outcomes = []
    for kind in offsets if is_verified else (case.kind,):
        outcome = Outcome(kind, case.seed, rig, case.num_pairs, case.noise)
        try:
            found = _verify(outcome, data, truth, rng) if is_verified else _calibrate(outcome, data, truth)
        except SemcalError as failure:
            found = replace(outcome, reasons=str(failure))
        outcomes.append(found)
    return outcomes


def _calibrate(outcome: Outcome, data: LoadedDrive, truth: Pose) -> Outcome:
    config = RefinementConfig("mine" if outcome.kind == "mine" else "exact")
    stages, calibration = calibrate_from(initialize(data, InitializationConfig()), data, config)
    return outcome.stating(calibration, errors_of(stages.T_camera_lidar, truth))


def _verify(outcome: Outcome, data: LoadedDrive, truth: Pose, rng: np.random.Generator) -> Outcome:
    from scipy.spatial.transform import Rotation

    change = np.eye(4)
    if outcome.kind == TURNED:
        about = rng.standard_normal(3)
        turn = Rotation.from_rotvec(about / np.linalg.norm(about) * TURNED_DEG, degrees=True)
        change[:3, :3] = turn.as_matrix()
    if outcome.kind in MOVED:
        change[MOVED.index(outcome.kind), 3] = MOVED_M * rng.choice([-1.0, 1.0])
    verification = verify(data, InitialPose(change @ truth, "the transform"), LIMITS)
    return replace(outcome, status=verification.verdict, reasons="; ".join(verification.reasons))
