"""Findings about intrinsics and clocks name the option that estimates them, and what it finds."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from conftest import with_twists

from semcal_cli.assessment import joint
from semcal_cli.assessment.joint import OF_CLOCKS, OF_INTRINSICS, advise
from semcal_cli.config import CalibrationConfig, JointlyConfig, PolishConfig, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import load_observations
from semcal_cli.errors import CalibrationError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import assess, refine_and_polish, start_at
from semcal_cli.result.stage import Finding
from semcal_cli.synthetic.synthesis import synthesize

FOCAL = Finding("focal-length", "the focal length looks wrong", "check K")
INTRINSICS = Finding("intrinsics", "the intrinsics look wrong", "check K")
CLOCKS = Finding("clocks", "the clocks look wrong", "check the clocks")
OTHER = Finding("overlap", "the sky is 3 m high", "add sky")
NAMES = "--refine-intrinsics fx,fy,cx,cy,k1"
CLOSE_SHARE = 0.01
"""Error of a focal length that four small images tell."""
CLOSE_MS = 2.0
"""Error of the clock that six small images tell."""


@pytest.fixture(scope="module")
def street_observations(fine_street: Path) -> Observations:
    """Those of the finer street, whose points tell both focal lengths."""
    return load_observations(read_drive(fine_street))


@pytest.fixture
def never(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is estimated."""

    def called(*_: object) -> None:
        raise AssertionError("estimated")

    monkeypatch.setattr(joint, "fit_jointly", called)


@pytest.mark.parametrize("scale", [0.95, 1.08])
def test_a_wrong_focal_length_is_told(
    street_observations: Observations, street_truth: Pose, scale: float
) -> None:
    right, wrong = street_observations.camera, street_observations.camera.zoomed(scale)
    seen = replace(street_observations, camera=wrong)
    other, focal, intrinsics = advise((OTHER, FOCAL, INTRINSICS), seen, street_truth, PolishConfig())
    assert other == OTHER
    assert focal.advice == intrinsics.advice
    found = re.match(
        rf"calibrate with {NAMES}, which finds fx (\d+\.\d+) -> (\d+\.\d+), fy (\d+\.\d+) -> ", focal.advice
    )
    assert found is not None, focal.advice
    given, fx, _ = map(float, found.groups())
    assert given == pytest.approx(wrong.K[0][0], abs=0.1)
    assert fx == pytest.approx(right.K[0][0], rel=CLOSE_SHARE)


@pytest.fixture(scope="module")
def early(tmp_path_factory: pytest.TempPathFactory) -> LoadedDrive:
    """A drive at mixed speeds, whose images are 20 ms earlier than their stamps say."""
    folder = tmp_path_factory.mktemp("early") / "drive"
    config = SynthConfig(num_frames=6, seed=11, width=640, height=360, motion="mixed", delay_ms=-20.0)
    synthesize(config, folder)
    return load(read_drive(folder), CalibrationConfig())


def test_wrong_clocks_are_told(early: LoadedDrive) -> None:
    """By a whole assessment, beside all other findings."""
    start = start_at(early, InitialPose(read_transform(early.drive.path), "start"))
    config = RefinementConfig()
    polished = refine_and_polish(early, start, config, from_afar=True)
    findings = assess(early, polished, config, with_label_bleed=False).findings
    (clocks,) = (finding for finding in findings if finding.topic == "clocks")
    found = re.fullmatch(
        r"calibrate with --estimate-delay, which finds that images are (\d+\.\d) ms earlier than their stamps say",
        clocks.advice,
    )
    assert found is not None, clocks.advice
    assert float(found[1]) == pytest.approx(20.0, abs=CLOSE_MS)
    plain = assess(early, polished, config, with_label_bleed=False, with_remedies=False)
    assert [finding.found for finding in plain.findings] == [finding.found for finding in findings]
    assert "--estimate-delay" not in " ".join(finding.advice for finding in plain.findings)


def test_wrong_clocks_are_told_also_where_the_polish_is_rejected(
    early: LoadedDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As if held-out data had to get better by a lot.
    monkeypatch.setattr("semcal_cli.config.PolishConfig", partial(PolishConfig, max_loss=-1e6))
    start = start_at(early, InitialPose(read_transform(early.drive.path), "start"))
    stages = refine_and_polish(early, start, RefinementConfig(), from_afar=True)
    found = assess(early, stages, RefinementConfig())
    assert found.uncertainty is None
    topics = [finding.topic for finding in found.findings]
    assert {"polish-rejected", "clocks"} <= {*topics}
    (clocks,) = (finding for finding in found.findings if finding.topic == "clocks")
    assert "--estimate-delay, which finds that images are " in clocks.advice


def test_both_are_estimated_together_and_the_drives_offset_is_part_of_it(early: LoadedDrive) -> None:
    pose = read_transform(early.drive.path)
    intrinsics, clocks = advise(
        (INTRINSICS, CLOCKS), early.observations, pose, PolishConfig(), time_offset_s=-0.1
    )
    assert intrinsics.advice == clocks.advice
    found = re.fullmatch(
        rf"calibrate with {NAMES} --estimate-delay, which finds .*fx .* and that images are (\d+\.\d) ms earlier "
        "than their stamps say",
        clocks.advice,
    )
    assert found is not None, clocks.advice
    assert float(found[1]) == pytest.approx(120.0, abs=CLOSE_MS)


def without_k1(seen: Observations) -> Observations:
    block = {"model": "equirectangular", "width": 640, "height": 360}
    camera = Camera.model_validate(block | {"K": [[102.0, 0.0, 320.0], [0.0, 102.0, 180.0], [0.0, 0.0, 1.0]]})
    return replace(seen, camera=camera)


def with_one_twist(seen: Observations) -> Observations:
    """A drive may state the motion of some of its frames only."""
    few = with_twists(seen.of_frames([0]), [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    return replace(seen, frame_observations=(*few.frame_observations, *seen.frame_observations[1:]))


MORE = ", or calibrate more frames with "


DONE = (JointlyConfig(("fx",), with_delay=True), JointlyConfig(("fx",)), JointlyConfig(with_delay=True))


@pytest.mark.usefixtures("never")
@pytest.mark.parametrize(
    ("findings", "change", "settings", "advices"),
    [
        ((), None, {}, []),
        ((OTHER,), None, {}, [OTHER.advice]),
        ((FOCAL, CLOCKS), None, {"done": DONE[0]}, [FOCAL.advice, CLOCKS.advice]),
        ((FOCAL, CLOCKS), None, {"done": DONE[1]}, [FOCAL.advice, f"check the clocks{MORE}--estimate-delay"]),
        ((FOCAL, CLOCKS), None, {"done": DONE[2]}, [f"check K{MORE}{NAMES}", CLOCKS.advice]),
        ((FOCAL,), None, {"with_priors": True}, [f"check K{MORE}{NAMES} and without priors"]),
        (
            (FOCAL,),
            without_k1,
            {"with_priors": True},
            [f"check K{MORE}--refine-intrinsics fx,fy,cx,cy and without priors"],
        ),
        ((CLOCKS,), with_one_twist, {}, [f"check the clocks{MORE}--estimate-delay"]),
    ],
)
def test_advice_that_costs_no_estimate(
    street_observations: Observations,
    street_truth: Pose,
    findings: tuple[Finding, ...],
    change: Callable[[Observations], Observations] | None,
    settings: dict[str, Any],
    advices: list[str],
) -> None:
    """Other findings, what was estimated already, priors, a lens without k1, and frames without a motion."""
    seen = street_observations if change is None else change(street_observations)
    found = advise(findings, seen, street_truth, PolishConfig(), **settings)
    assert [finding.advice for finding in found] == advices


def test_right_intrinsics_are_not_kept_and_not_told(
    street_observations: Observations, street_truth: Pose
) -> None:
    (focal,) = advise((FOCAL,), street_observations, street_truth, PolishConfig())
    assert focal.advice == f"check K{MORE}{NAMES}"


@pytest.mark.parametrize("error", [CalibrationError("labels tell nothing"), ValueError("fx: found -3")])
def test_an_estimate_that_fails_leaves_the_advice(
    street_observations: Observations,
    street_truth: Pose,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(joint, "fit_jointly", fails)
    (focal,) = advise((FOCAL,), street_observations, street_truth, PolishConfig())
    assert focal.advice == f"check K{MORE}{NAMES}"


@pytest.mark.parametrize("topic", [*OF_INTRINSICS, *OF_CLOCKS])
def test_the_page_of_reasons_quotes_both_advices(topic: str) -> None:
    page = (Path(__file__).parents[1] / "docs/troubleshooting.md").read_text(encoding="utf-8")
    _, _, entry = page.partition(f'<a id="{topic}"></a>')
    entry, _, _ = entry.partition("###")
    assert ": calibrate with --" in entry
    assert ", or calibrate more frames with --" in entry
