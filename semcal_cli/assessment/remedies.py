"""What is advised where intrinsics or clocks look wrong: the option that estimates them, and the values it would give.

The estimate costs time, so it is made only where such a finding is there, and only once for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.assessment.joint import fit_jointly
from semcal_cli.config import JointlyConfig, PolishConfig
from semcal_cli.drive.camera import CAMERA_MODELS, OF_K
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
    done, topics = done or JointlyConfig(), {finding.topic for finding in findings}
    intrinsics: tuple[str, ...] = ()
    if not done.intrinsics and topics & {*OF_INTRINSICS}:
        intrinsics = (*OF_K, *[RADIAL] * (RADIAL in CAMERA_MODELS[observations.camera.model].coefficients))
    asked = JointlyConfig(intrinsics, with_delay=not done.with_delay and bool(topics & {*OF_CLOCKS}))
    if not asked.is_asked:
        return tuple(findings)
    options = [f"--refine-intrinsics {','.join(intrinsics)}"] * bool(intrinsics)
    options += ["--estimate-delay"] * asked.with_delay + ["and without priors"] * with_priors
    values = None
    if not with_priors and not done.is_asked:
        values = _values(observations, T_camera_lidar, asked, polish, time_offset_s)

    def advised(finding: Finding) -> Finding:
        if not (
            (finding.topic in OF_INTRINSICS and intrinsics)
            or (finding.topic in OF_CLOCKS and asked.with_delay)
        ):
            return finding
        if values is None:
            advice = f"{finding.advice}, or calibrate more frames with {' '.join(options)}"
        else:
            advice = f"calibrate with {' '.join(options)}, which finds {values}"
        return finding._replace(advice=advice)

    return tuple(advised(finding) for finding in findings)


def _values(
    observations: Observations,
    T_camera_lidar: Pose,
    asked: JointlyConfig,
    polish: PolishConfig,
    time_offset_s: float,
) -> str | None:
    """Estimate what looks wrong, and say what is determined; None if the estimate is not kept, or there is none."""
    if asked.with_delay and twists_per_s(observations) is None:
        return None
    try:
        found = fit_jointly(observations, T_camera_lidar, asked, polish, time_offset_s)
    except (SemcalError, ValueError):
        return None  # An advice must not end the run whose finding it is for.
    if not found.is_kept:
        return None
    words, texts = [], [] if found.camera is None else intrinsic_texts(found.camera)
    if changes := [f"{each.name} {each.given} -> {each.found}" for each in texts if each.half_width]:
        words.append(", ".join(changes))
    if found.clock is not None and found.clock.is_determined:
        words.append(f"that {found.clock.meaning}")
    return " and ".join(words)
