"""Calibrations and verifications of drives with known truth, and what each states of itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import InitializationConfig, Limits, RefinementConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import LabelledCloud, Observations
from semcal_cli.drive.reading import mend, read_observations
from semcal_cli.errors import SemcalError
from semcal_cli.experiments import spoiled
from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.outcome import Case, Outcome, errors_of, with_statement
from semcal_cli.experiments.parts import PARTS
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.rows import calibrate_from
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import initialize
from semcal_cli.pipeline.verification import verify
from semcal_cli.synthetic.label_noise import with_shared_errors, with_wrong_labels

PAIRS = (1, 2, 3, 5, 10, 20)
NOISES = (0.0, 0.1, 0.2, 0.3)
VERIFY_DRAWS = 5
"""Number of times that a drive's labels are corrupted for `verify`, with transforms off in other directions."""
SHARED = "classes off alike in all frames"
"""Good drives whose classes' borders are a little off in every picture, as a network draws them."""
SHARED_PAIRS = (5, 20)
MINE_PAIRS = 10
MINE_EVERY = SPOILED_EVERY = 5
"""Step between the seeds whose drive is also calibrated with MINE, or spoiled; it covers all rigs in turn."""
OTHER_DRIVE = len(RIGS)
"""Step to the seed whose drive replaces the images: the next one of the same rig."""
LIMITS = Limits(rotation_deg=0.1, translation_m=0.02)
TURNED_DEG = 0.2
MOVED_M = 0.03


@dataclass(frozen=True)
class Scene:
    """The truth of a drive, and another drive, for making it impossible to calibrate."""

    truth: Pose
    """(4, 4) true T_camera_lidar of the drive."""
    other: Callable[[], Observations]
    """Reads another drive of the same rig."""


Degrade = Callable[[Observations, Scene, np.random.Generator], Observations]


def _one_class(observations: Observations, scene: Scene, rng: np.random.Generator) -> Observations:
    """Give all points and pixels one class, except for a few wrong labels."""
    clouds, images = observations.clouds, observations.images
    point = np.argmax(np.bincount(np.concatenate([cloud.classes for cloud in clouds])))
    pixel = np.argmax(np.bincount(np.concatenate([image.classes.ravel() for image in images])))

    def mostly(one: np.intp, ids: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        return np.where(rng.random(ids.shape) < 0.01, ids, one).astype(np.uint8)

    few = [cloud.with_classes(mostly(point, cloud.classes)) for cloud in clouds]
    return observations.with_clouds(few).with_images(
        image.with_classes(mostly(pixel, image.classes)) for image in images
    )


def _shuffled(observations: Observations, scene: Scene, rng: np.random.Generator) -> Observations:
    return observations.with_clouds(
        cloud.with_classes(rng.permutation(cloud.classes)) for cloud in observations.clouds
    )


def _wrong_focal_length(observations: Observations, scene: Scene, rng: np.random.Generator) -> Observations:
    camera = observations.camera.zoomed(1.1 if rng.random() < 0.5 else 0.9)
    return replace(observations, camera=camera)


def _other_images(observations: Observations, scene: Scene, rng: np.random.Generator) -> Observations:
    """Replace the images by those of another drive, with classes matched by name."""
    other = scene.other()
    some = other.of_frames(range(observations.num_frames))
    places = {name: place for place, name in enumerate(observations.image_class_names)}
    names = [*other.image_class_names, *["none"] * (256 - len(other.image_class_names))]
    table = np.array([places.get(name, 255) for name in names], np.uint8)
    return observations.with_images(
        own.with_classes(table[image.classes])
        for own, image in zip(observations.images, some.images, strict=True)
    )


def _behind(observations: Observations, scene: Scene, rng: np.random.Generator) -> Observations:
    """Keep only the points that the camera cannot see: behind it, or outside its image."""
    camera = core_camera(observations.camera)
    clouds = []
    for cloud in observations.clouds:
        pixels = _core.project_points(camera, cloud.points, scene.truth).pixels
        outside = ~np.isfinite(pixels).all(axis=1)
        clouds.append(LabelledCloud(cloud.points[outside], cloud.classes[outside]))
    return observations.with_clouds(clouds)


BAD: dict[str, Degrade] = {
    "one class everywhere": _one_class,
    "pictures of another drive": _other_images,
    "sweeps behind the camera only": _behind,
    "labels shuffled": _shuffled,
    "K wrong by 10 %": _wrong_focal_length,
}
"""Changes that make a drive impossible to calibrate, by name."""
AS_IT_IS, TURNED = "as it is", f"{TURNED_DEG} degrees off"
MOVED = tuple(f"{100 * MOVED_M:.0f} cm off along {axis}" for axis in "xyz")
OFFSETS = (AS_IT_IS, TURNED, *MOVED)
"""Names of the transforms to verify: turned about a random axis of the camera, or moved along one of its axes."""


def cases(seeds: range, parts: Sequence[str] = PARTS) -> list[Case]:
    """List the cases of some parts of the experiment, seed by seed.

    Each seed has six calibrations of a good drive, two with errors of classes, five of bad ones, and five rounds of
    three verifications. A round without wrong labels occurs only once: another one would be the same. Every fifth seed
    also has a calibration with MINE, and a drive for each way of spoiling; if no other parts are asked for, every seed
    has them.
    """
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        found += [Case("good", seed, num_pairs, float(rng.choice(NOISES))) for num_pairs in PAIRS]
        found += [Case(kind, seed, int(rng.choice(PAIRS)), float(rng.choice(NOISES))) for kind in BAD]
        found += [Case(SHARED, seed, num_pairs, 0.0) for num_pairs in SHARED_PAIRS]
        noises = [*NOISES, *rng.choice(NOISES[1:], VERIFY_DRAWS - len(NOISES)).tolist()]
        found += [Case("verify", seed, PAIRS[-1], noise, draw) for draw, noise in enumerate(noises)]
        if seed % MINE_EVERY == 0:
            found.append(Case("mine", seed, MINE_PAIRS, float(rng.choice(NOISES))))
        if seed % SPOILED_EVERY == 0 or set(parts) <= {"spoiled", "subtle"}:
            found += spoiled.cases(seed)
    return [case for case in found if _part(case.kind) in parts]


def _part(kind: str) -> str:
    """Name the part of the experiment to which a kind belongs."""
    if kind in spoiled.KINDS:
        return "subtle" if spoiled.KINDS[kind].is_subtle else "spoiled"
    return "bad" if kind in BAD else "verify" if kind == "verify" else "good"


@dataclass(frozen=True)
class Runner:
    """Runs a case; it can be pickled for other processes."""

    pool: Pool
    pool_with_pictures: Pool
    """Pool of the drives that are spoiled."""

    def __call__(self, case: Case) -> list[Outcome]:
        """Calibrate or verify, and compare with the truth."""
        if case.kind in spoiled.KINDS:
            return [spoiled.run(case, self.pool_with_pictures)]
        rig = list(RIGS)[case.seed % len(RIGS)]
        rng = np.random.default_rng((case.seed, case.num_pairs, case.draw, *case.kind.encode()))
        drive, truth = self.pool.read(rig, RIGS[rig], case.seed)
        observations = read_observations(drive)
        chosen = np.sort(rng.choice(observations.num_frames, case.num_pairs, replace=False)).tolist()
        data = LoadedDrive(drive, observations).of_frames(chosen)
        observations = with_wrong_labels(data.observations, case.noise, rng)
        if case.kind == SHARED:
            observations = with_shared_errors(observations, rng)
        if (degrade := BAD.get(case.kind)) is not None:
            scene = Scene(truth, lambda: with_wrong_labels(self._other(case.seed, rig), case.noise, rng))
            observations = degrade(observations, scene, rng)
        data = replace(data, observations=mend(observations))

        def attempt(kind: str, work: Callable[[Outcome], Outcome]) -> Outcome:
            outcome = Outcome(kind, case.seed, rig, case.num_pairs, case.noise, "failed", "")
            try:
                return work(outcome)
            except SemcalError as failure:
                return replace(outcome, reasons=str(failure))

        if case.kind == "verify":
            return [
                attempt(kind, lambda outcome: _verify(outcome, data, truth, rng))
                for kind in (AS_IT_IS, TURNED, MOVED[(case.seed + case.draw) % len(MOVED)])
            ]
        return [attempt(case.kind, lambda outcome: _calibrate(outcome, data, truth))]

    def _other(self, seed: int, rig: str) -> Observations:
        return read_observations(self.pool.read(rig, RIGS[rig], seed + OTHER_DRIVE)[0])


def _calibrate(outcome: Outcome, data: LoadedDrive, truth: Pose) -> Outcome:
    config = RefinementConfig("mine" if outcome.kind == "mine" else "exact")
    stages, calibration = calibrate_from(initialize(data, InitializationConfig()), data, config)
    return with_statement(outcome, calibration, errors_of(stages.T_camera_lidar, truth))


def _verify(outcome: Outcome, data: LoadedDrive, truth: Pose, rng: np.random.Generator) -> Outcome:
    initial_pose = InitialPose(_off(truth, outcome.kind, rng), "the transform")
    verification = verify(data, initial_pose, LIMITS)
    return replace(outcome, status=verification.verdict, reasons="; ".join(verification.reasons))


def _off(truth: Pose, kind: str, rng: np.random.Generator) -> Pose:
    from scipy.spatial.transform import Rotation

    change = np.eye(4)
    if kind == TURNED:
        about = rng.standard_normal(3)
        turn = Rotation.from_rotvec(about / np.linalg.norm(about) * TURNED_DEG, degrees=True)
        change[:3, :3] = turn.as_matrix()
    if kind in MOVED:
        change[MOVED.index(kind), 3] = MOVED_M * rng.choice([-1.0, 1.0])
    T: Pose = change @ truth
    return T
