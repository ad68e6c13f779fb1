"""Calibrations of spoiled drives: which are trusted although wrong, and which say what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from laboratory import spoiling
from laboratory.diagnosis import (
    Diagnose,
    attempt,
    covers_intrinsics,
    matches_one_frame,
    names_knock,
    names_leak,
    names_scale,
)
from laboratory.outcomes import Case, Outcome, distance_in_limits, errors_of
from laboratory.raw_drive import RawDrive, read_raw_drive
from laboratory.rigs import RIGS, rig_of

from semcal_cli.errors import SemcalError
from semcal_cli.experiments.drives import NUM_FRAMES, Pool
from semcal_cli.observations.frame_selection import with_frames

PAIRS = (10, 20)
NOISES = (0.0, 0.1, 0.2, 0.3)
STRONG_NOISES = (0.2, 0.3)
LATE_S = 0.03
SPEEDS_M_S = {"at 10 m/s": (10.0, 10.0), "at 0 to 20 m/s": (0.0, 20.0)}
MISPLACED_PX = 8
MOMENT_PAIRS = 6
"""Number of pairs, one of which has an image from another moment."""
MOUNTINGS_DEG = 10.0, 11.0
"""Azimuths of the camera in the two halves of a drive with two mountings; backward cameras look the other way."""
SECOND_SEED = 500_000
"""Offset to the seed of the second half."""
Spoil = Callable[[RawDrive, np.random.Generator], RawDrive]


@dataclass(frozen=True)
class Kind:
    """A way in which drives are spoiled."""

    spoil: Spoil
    """Function that spoils a good drive."""
    group: str
    """Name of the kinds that are counted together."""
    diagnose: Diagnose | None = None
    """Function that decides whether the result says what is wrong; None if it need not."""
    num_pairs: tuple[int, ...] = PAIRS
    """Numbers of pairs of the spoiled drives."""
    num_read: int | None = None
    """Number of frames of the good drive; None for that of the spoiled drive."""
    has_two_mountings: bool = False
    """Whether the second half of the frames is from another drive of the rig, whose camera looks elsewhere."""
    noises: tuple[float, ...] = NOISES
    """Fractions of wrong labels in the good drives."""
    has_images: bool = True
    """Whether the spoiled drive names its images."""
    has_point_labels: bool = True
    """Whether it has point labels; without them and without images it is calibrated by segments."""
    has_exact_intrinsics: bool = True
    """Whether it states that K is exact, as synthetic drives do; otherwise it states nothing about K."""

    @property
    def is_subtle(self) -> bool:
        """Whether it belongs to the part `subtle`: what is wrong hardly shows, so only the interval can cover it."""
        return self.group in SUBTLE


def _by_segments(kinds: Mapping[str, Kind]) -> dict[str, Kind]:
    """Declare the same kinds with image labels only."""
    return {
        f"{name}, by segments": replace(kind, has_point_labels=False, has_images=False)
        for name, kind in kinds.items()
    }


def _by_both(name: str, kind: Kind) -> dict[str, Kind]:
    """Declare a kind with labels on both sides, and the same by segments."""
    return {name: kind, **_by_segments({name: kind})}


KNOCKED, SCALE, PRINCIPAL_POINT = "camera knocked", "clouds scaled", "principal point wrong"
COPIES, SHIFTED, MERGED = "copies of a frame", "labels shifted", "classes merged"
NOISY, LATE, SLIGHTLY_WRONG_K = "4 frames with noisy labels", "images late", "intrinsics slightly wrong"
MISPLACED, LEAKED, SINGLE = "label images misplaced", "leaked labels", "single frames"
SEGMENTS = "good drives by segments"
SUBTLE = (NOISY, LATE, SLIGHTLY_WRONG_K, MISPLACED, LEAKED, SINGLE, SEGMENTS)
"""Groups of the part `subtle`."""
SHARES = {"half of the frames": 0.5, "a quarter of the frames": 0.25, "some frames": None}
TURNS = {f"turned by {angle:g} degrees": (angle, 0.0) for angle in (0.5, 1.0, 3.0)}
MOVES = {f"moved by {100 * distance:.0f} cm": (0.0, distance) for distance in (0.1, 0.2)}
"""Knocks of the camera: degrees and metres."""
SLIGHTLY = partial(Kind, group=SLIGHTLY_WRONG_K, has_exact_intrinsics=False)
OFF_ITS_PLACE = partial(
    Kind,
    group=MISPLACED,
    diagnose=partial(covers_intrinsics, {"cx": MISPLACED_PX, "cy": MISPLACED_PX}),
    has_images=False,
    has_exact_intrinsics=False,
)
BY_A_NETWORK = partial(Kind, spoiling.labels_by_a_network, noises=(0.0,))
KINDS: dict[str, Kind] = {
    **{
        f"{where} {how}": Kind(
            partial(spoiling.knocked, angle_deg=angle_deg, distance_m=distance_m, share=share),
            KNOCKED,
            names_knock,
        )
        for knocks in (TURNS, MOVES)
        for where, share in SHARES.items()
        for how, (angle_deg, distance_m) in knocks.items()
    },
    "two mountings, 1 degree apart": Kind(spoiling.as_it_is, KNOCKED, names_knock, has_two_mountings=True),
    "each cloud turned by its own 0.7 to 1 degrees": Kind(spoiling.clouds_turned, "clouds turned"),
    **{
        f"point labels shifted by {n}": Kind(partial(spoiling.point_labels_shifted, entries=n), SHIFTED)
        for n in (1, 3, 5)
    },
    "image labels shifted by 3 to 4 px": Kind(spoiling.image_labels_shifted, SHIFTED),
    "the same in every other frame": Kind(partial(spoiling.image_labels_shifted, step=2), SHIFTED),
    "cx wrong by 4 px": Kind(
        partial(spoiling.principal_point_wrong, cx_px=4.0),
        PRINCIPAL_POINT,
        partial(covers_intrinsics, {"cx": 4.0}),
    ),
    "cy wrong by 15 px": Kind(
        partial(spoiling.principal_point_wrong, cy_px=15.0),
        PRINCIPAL_POINT,
        partial(covers_intrinsics, {"cy": 15.0}),
    ),
    "fx alone wrong by 3 %": Kind(partial(spoiling.focal_length_wrong, share=0.03), "focal length wrong"),
    **{
        f"clouds {name}": Kind(partial(spoiling.clouds_scaled, scale=scale), SCALE, names_scale)
        for name, scale in (("scaled by 0.95", 0.95), ("scaled by 1.2", 1.2), ("in feet", 1.0 / 0.3048))
    },
    **{
        f"one frame {times} times{words}": Kind(
            partial(spoiling.one_frame_again, times=times, noise_m=noise_m, is_renamed=times > 20),
            COPIES,
            matches_one_frame,
            num_pairs=(times,),
            num_read=1,
        )
        for times in (20, 70)
        for words, noise_m in (("", None), (", with 5 mm of noise", 0.005))
    },
    "classes merged to two at random": Kind(spoiling.classes_merged, MERGED),
    "classes merged to 3, 9, 11 and the rest": Kind(
        partial(spoiling.classes_merged, first=(3, 9, 11)), MERGED
    ),
    "half of the images mirrored": Kind(spoiling.images_mirrored, "images exchanged"),
    "one image of another moment": Kind(
        spoiling.image_of_another_moment, "images exchanged", num_pairs=(MOMENT_PAIRS,)
    ),
    **_by_segments(
        {
            "20 or 30 % wrong labels": Kind(spoiling.as_it_is, NOISY, num_pairs=(4,), noises=STRONG_NOISES),
            "labels as by a network": BY_A_NETWORK(NOISY, num_pairs=(4,)),
        }
    ),
    **{
        name: kind
        for how, speeds in SPEEDS_M_S.items()
        for name, kind in _by_both(
            f"images {1000 * LATE_S:.0f} ms late {how}",
            Kind(partial(spoiling.images_late, late_s=LATE_S, speeds_m_s=speeds), LATE),
        ).items()
    },
    **_by_both(
        "f wrong by 1 %",
        SLIGHTLY(
            partial(spoiling.zoom_wrong, share=0.01),
            diagnose=partial(covers_intrinsics, {"fx": 10.0, "fy": 10.0}),
        ),
    ),
    **_by_both(
        "cy wrong by 10 px",
        SLIGHTLY(
            partial(spoiling.principal_point_wrong, cy_px=10.0),
            diagnose=partial(covers_intrinsics, {"cy": 10.0}),
        ),
    ),
    **_by_both(
        f"label images shifted by {MISPLACED_PX} px",
        OFF_ITS_PLACE(partial(spoiling.image_labels_shifted, distance_px=(MISPLACED_PX, MISPLACED_PX))),
    ),
    **_by_both(
        f"label images cropped by {MISPLACED_PX} px",
        OFF_ITS_PLACE(partial(spoiling.image_labels_cropped, pixels=MISPLACED_PX)),
    ),
    "points labelled from images through a wrong transform": Kind(
        spoiling.point_labels_from_images, LEAKED, names_leak
    ),
    "a single frame": Kind(spoiling.as_it_is, SINGLE, num_pairs=(1,)),
    "a single frame with labels as by a network": BY_A_NETWORK(SINGLE, num_pairs=(1,)),
    **_by_segments({"a good drive": Kind(spoiling.as_it_is, SEGMENTS)}),
    "points labelled from a network's images through a wrong transform": Kind(
        partial(spoiling.point_labels_from_images, is_by_a_network=True), LEAKED, names_leak, noises=(0.0,)
    ),
}
"""Ways to spoil a drive, by name."""


def cases(seed: int) -> list[Case]:
    """List the cases of one seed: each kind once, with a random number of pairs and fraction of wrong labels."""
    rng = np.random.default_rng((seed, len(RIGS)))
    return [
        Case(name, seed, int(rng.choice(kind.num_pairs)), float(rng.choice(kind.noises)))
        for name, kind in KINDS.items()
    ]


def run(pool: Pool, case: Case) -> list[Outcome]:
    """Spoil a drive, calibrate it, and compare the pose with the nearest of its true poses."""
    kind, rig = KINDS[case.kind], rig_of(case.seed)
    rng = np.random.default_rng((case.seed, case.num_pairs, *case.kind.encode()))
    raw = withhold_unstated(kind, kind.spoil(_good_drive(pool, rig, case, rng), rng))
    found = attempt(raw)
    outcome = Outcome(case.kind, case.seed, rig, case.num_pairs, case.noise)
    if isinstance(found, SemcalError):
        outcome = replace(outcome, reasons=str(found))
    else:
        errors = [errors_of(found.pose, truth) for truth in raw.truths]
        outcome = outcome.stating(found, min(errors, key=distance_in_limits))
    return [outcome if kind.diagnose is None else kind.diagnose(raw, found, outcome)]


def _good_drive(pool: Pool, rig: str, case: Case, rng: np.random.Generator) -> RawDrive:
    """Read randomly chosen frames of a drive and a spare one, and give them wrong labels."""
    kind = KINDS[case.kind]
    num_frames = kind.num_read or case.num_pairs
    if kind.has_two_mountings:
        return spoiling.wrong_labels(_two_mountings(pool, rig, case.seed, num_frames), rng, case.noise)
    drive, truth = pool.read(rig, RIGS[rig], case.seed)
    chosen = rng.choice(len(drive.frames), min(num_frames + 1, len(drive.frames)), replace=False)
    order = [*np.sort(chosen[:num_frames]).tolist(), *chosen[num_frames:].tolist()]
    raw = spoiling.wrong_labels(read_raw_drive(with_frames(drive, order), truth), rng, case.noise)
    return replace(raw, frames=raw.frames[:num_frames], unused=raw.frames[num_frames:])


def withhold_unstated(kind: Kind, raw: RawDrive) -> RawDrive:
    """Leave out what the spoiled drive does not state."""
    raw = replace(raw, has_point_labels=kind.has_point_labels)
    if not kind.has_exact_intrinsics:
        raw = raw.with_document(camera=raw.drive.camera.model_copy(update={"intrinsics_sigma": None}))
    if not kind.has_images:
        raw = raw.with_frames(replace(frame, image=None) for frame in raw.frames)
    return raw


def _two_mountings(pool: Pool, rig: str, seed: int, num_frames: int) -> RawDrive:
    """Read frames of two drives of one rig, between which the camera was remounted."""
    backward = RIGS[rig].get("camera_azimuth_deg") is not None
    halves = []
    for half, azimuth_deg in enumerate(MOUNTINGS_DEG):
        changes = RIGS[rig] | {
            "camera_azimuth_deg": azimuth_deg - 180.0 if backward else azimuth_deg,
            "rig_seed": seed,
            "num_frames": min(NUM_FRAMES, max(PAIRS)) // 2,
        }
        drive, truth = pool.read(f"{rig}_at_{azimuth_deg:g}", changes, seed + half * SECOND_SEED)
        halves.append(read_raw_drive(with_frames(drive, range(num_frames // 2)), truth, prefix=f"{half}_"))
    return halves[0].with_frames([frame for half in halves for frame in half.frames])
