"""What is advised where intrinsics or clocks look wrong: the option that estimates them, and the values it would give.

The estimate costs time, so it is made only where such a finding is there, and only once for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.assessment.joint import Joint, fit_jointly
from semcal_cli.config import JointlyConfig, PolishConfig
from semcal_cli.drive.camera import CAMERA_MODELS, OF_K, Camera
from semcal_cli.drive.motion import twists_per_s
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import SemcalError
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.camera import intrinsic_texts
from semcal_cli.result.stage import Finding

OF_INTRINSICS = ("focal-length", "intrinsics")
"""Topics of findings that `--refine-intrinsics` is about."""
OF_CLOCKS = ("clocks",)
"""Topics of findings that `--estimate-delay` is about."""
RADIAL = "k1"


def advise(
    findings: Sequence[Finding],
    observations: Observations,
    T_camera_lidar: Pose,
    polish: PolishConfig,
    *,
    done: JointlyConfig | None = None,
    with_priors: bool = False,
    time_offset_s: float = 0.0,
) -> tuple[Finding, ...]:
    """Name the options that estimate what looks wrong, with the values that they would give.

    Args:
        findings: All findings; those about other things stay as they are.
        observations: Labelled points and label images of all frames.
        T_camera_lidar: (4, 4) polished pose, metres.
        polish: Settings of the polish.
        done: What was estimated together with the pose already: nothing is estimated then, and its options are not
            named again.
        with_priors: Whether the pose was fused with priors, which such an estimate does not take.
        time_offset_s: Time by which the observations take pictures to be later than their stamps, seconds.
    """
    asked = _asked(findings, observations.camera, done or JointlyConfig())
    if not asked.is_asked:
        return tuple(findings)
    option = _option(asked)
    found = None
    if with_priors:
        option += " and without priors"
    elif done is None or not done.is_asked:
        found = _estimate(observations, T_camera_lidar, asked, polish, time_offset_s)
    advised = []
    for finding in findings:
        if finding.topic not in _topics(asked):
            advised.append(finding)
        elif found is None:
            advised.append(
                finding._replace(advice=f"{finding.advice}, or calibrate more frames with {option}")
            )
        else:
            advised.append(finding._replace(advice=f"calibrate with {option}, which finds {_values(found)}"))
    return tuple(advised)


def _asked(findings: Sequence[Finding], camera: Camera, done: JointlyConfig) -> JointlyConfig:
    """Choose what to estimate, without what was estimated already."""
    topics = {finding.topic for finding in findings}
    names: tuple[str, ...] = ()
    if not done.intrinsics and topics & {*OF_INTRINSICS}:
        names = (*OF_K, RADIAL) if RADIAL in CAMERA_MODELS[camera.model].coefficients else tuple(OF_K)
    return JointlyConfig(names, with_delay=not done.with_delay and bool(topics & {*OF_CLOCKS}))


def _topics(asked: JointlyConfig) -> tuple[str, ...]:
    return (OF_INTRINSICS if asked.intrinsics else ()) + (OF_CLOCKS if asked.with_delay else ())


def _option(asked: JointlyConfig) -> str:
    options = [f"--refine-intrinsics {','.join(asked.intrinsics)}"] * bool(asked.intrinsics)
    return " ".join(options + ["--estimate-delay"] * asked.with_delay)


def _estimate(
    observations: Observations,
    T_camera_lidar: Pose,
    asked: JointlyConfig,
    polish: PolishConfig,
    time_offset_s: float,
) -> Joint | None:
    """Estimate what looks wrong; None if the estimate is not kept, or there is none."""
    if asked.with_delay and twists_per_s(observations) is None:
        return None
    try:
        found = fit_jointly(observations, T_camera_lidar, asked, polish, time_offset_s)
    except (SemcalError, ValueError):
        return None  # An advice must not end the run whose finding it is for.
    return found if found.is_kept else None


def _values(found: Joint) -> str:
    """Say what was found, as far as it is determined."""
    words = []
    texts = [] if found.camera is None else intrinsic_texts(found.camera)
    if changes := [f"{each.name} {each.given} -> {each.found}" for each in texts if each.half_width]:
        words.append(", ".join(changes))
    if found.clock is not None and found.clock.is_determined:
        words.append(f"that {found.clock.meaning}")
    return " and ".join(words)
