"""A calibration's verdict and uncertainty in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semcal_cli.config import PolishConfig
from semcal_cli.errors import listed
from semcal_cli.estimation.adjust.frame_offsets import FrameOffsets
from semcal_cli.observations.cues.cue_table import cues_of_options, policy_of
from semcal_cli.readable import figure
from semcal_cli.report.input import ReportInput
from semcal_cli.report.template import PageVerdict, link_reasons
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.refined_camera import clock_sentence, kept_sentence
from semcal_cli.result.uncertainty import stated_error

RANGE_M = 10.0
"""Range for which a sentence says how to read the maps of errors in the image."""
TITLES = {"trusted": "Trusted", "not_trusted": "Not trusted", "not_assessed": "Not assessed"}
NOT_BELIEVED = (
    "A transform that is not trusted has no interval here: it may be off by far more than the figures say."
)


def verdict(report: ReportInput) -> PageVerdict:
    """State whether the transform may be used."""
    record = report.record
    if record is None:
        return PageVerdict(
            "not_assessed",
            TITLES["not_assessed"],
            "The file holds only a transform, not how it was found. The figures below were measured with it; "
            "semcal verify checks whether it holds.",
        )
    if not report.is_of_record:
        return PageVerdict(
            "not_assessed",
            "Not assessed here",
            f"On the data that it was computed from, it was {record.status.replace('_', ' ')}. The figures below were "
            "measured on other data; semcal verify checks whether it holds there.",
            reasons=link_reasons(record.reasons, record.topics),
        )
    return verdict_of(record)


def verdict_of(record: CalibrationDocument) -> PageVerdict:
    """State whether the transform of a calibration may be used, and how good it is."""
    sentence = {
        "trusted": "No check found a problem.",
        "not_trusted": "Reasons:",
        "not_assessed": "It was not polished, so its uncertainty is unknown.",
    }[record.status]
    figures = ""
    if record.believed_uncertainty is not None:
        figures = stated_error(record.believed_uncertainty, record.used_camera)
    reasons = link_reasons(record.reasons, record.topics)
    return PageVerdict(record.status, TITLES[record.status], sentence, figures, reasons)


def uncertainty_sentences(record: CalibrationDocument) -> list[str]:
    """Describe how uncertain a pose is."""
    if record.uncertainty is None:
        return [f"Its error is unknown: {_why_unknown(record)}."]
    if record.believed_uncertainty is None:
        return [NOT_BELIEVED, *_of_seeds(record)]
    uncertainty = record.believed_uncertainty
    x, y, z = (100.0 * half for half in uncertainty.half_width_95_camera_center_m)
    pitch, yaw, roll = uncertainty.half_width_95_rotation_deg
    sentences = [
        f"The camera is within {figure(x)} cm of the stated position to the left or right, {figure(y)} cm up or down, "
        f"and {figure(z)} cm forward or back; its rotation is within {figure(pitch)} degrees in pitch, "
        f"{figure(yaw)} in yaw and {figure(roll)} in roll (95 % intervals).",
        *(f"Least certain: {direction}." for direction in uncertainty.weak_directions),
    ]
    if uncertainty.label_bleed is not None:
        shift_cm = 100.0 * math.hypot(*uncertainty.label_bleed.camera_center_m)
        rotation_deg = math.hypot(*uncertainty.label_bleed.rotation_deg)
        sentences.append(
            f"If labels bled by one pixel in all images, the camera would be off by {figure(shift_cm)} cm and "
            f"{figure(rotation_deg)} degrees. More frames do not reduce that; better labels do."
        )
    if uncertainty.intrinsics_cost is not None:
        shift_m, rotation_deg = uncertainty.intrinsics_cost.together
        sentences.append(
            f"If cx and cy were off by 1 pixel and fx and fy by 0.1 %, the camera would be off by "
            f"{figure(100.0 * shift_m)} cm and {figure(rotation_deg)} degrees. All frames share K, so more frames do "
            f"not reduce that: {_what_intervals_include(record)}."
        )
    return [*sentences, *_of_seeds(record), *_of_folds(record)]


def map_sentences(record: CalibrationDocument) -> list[str]:
    """Describe how to read the maps of the interval over the image; empty without an interval."""
    if record.believed_uncertainty is None:
        return []
    in_image = record.believed_uncertainty.with_pixels(record.used_camera).in_image
    errors = next((errors for errors in in_image if errors.range_m == RANGE_M), None)
    if errors is None:
        return []
    worst = f"{figure(errors.worst_px)} pixels"
    within = f"{worst} of where it should, even"
    if errors.ahead_px is not None:
        within = f"{figure(errors.ahead_px)} pixels of where it should straight ahead, and within {worst}"
    return [
        f"In 95 of 100 calibrations, a point {RANGE_M:g} m from the camera lands within {within} at the worst place of "
        "the image.",
        f"Colours show that distance for points at three ranges along the ray of each pixel, in the worst direction."
        f"{_of_K_in_the_image(record)}",
    ]


def _of_K_in_the_image(record: CalibrationDocument) -> str:
    uncertainty = record.uncertainty
    if uncertainty is None or uncertainty.covariance_of_intrinsics is None:
        return ""
    if uncertainty.twist_by_intrinsics is None:  # an older file
        return (
            " Errors of K count by what they do to the transform, although both largely cancel in the image."
        )
    return " Points are projected with the K of the transform: what its errors do to both largely cancels."


def _of_seeds(record: CalibrationDocument) -> list[str]:
    """Describe how far the poses of other seeds differ, if there are any."""
    repeatability = record.repeatability
    if repeatability is None:
        return []
    cm, deg = 100.0 * repeatability.farthest_camera_center_m, repeatability.farthest_rotation_deg
    farthest = f"{figure(cm)} cm and {figure(deg)} degrees"
    failed = f"; {repeatability.num_failed} failed" if repeatability.num_failed else ""
    return [f"The poses of {repeatability.num_seeds} seeds differ from it by up to {farthest}{failed}."]


def _of_folds(record: CalibrationDocument) -> list[str]:
    """Describe how far the poses by parts of the drive differ, if there are any."""
    folds = record.cross_validation
    if folds is None or folds.pulls is None:
        return []
    least, most = min(folds.pulls), max(folds.pulls)
    return [
        f"The poses by {folds.num_folds} parts of the drive alone differ {figure(least)} to {figure(most)} times as "
        f"far as the scatter within their images predicts: about 1 where the intervals are right."
    ]


def _what_intervals_include(record: CalibrationDocument) -> str:
    """Name the errors of K that are part of the intervals."""
    if record.camera is not None and record.camera.is_kept:
        return "K was estimated together with the pose, and the intervals include its uncertainty"
    if record.camera is not None:
        return "the estimate of K was not kept, and the intervals include the remaining uncertainty of K"
    if record.uncertainty is None or record.uncertainty.covariance_of_intrinsics is None:
        return "the intervals assume that K is right"
    if record.input.camera.intrinsics_sigma is not None:
        return "the intervals include the stated errors of K"
    return (
        "the intervals include errors of K of 0.1 % and 1 pixel, because the drive states no intrinsics_sigma"
    )


def camera_sentences(record: CalibrationDocument) -> list[str]:
    """State whether the intrinsics and the clock that were estimated are used; empty if none were."""
    sentences = []
    if record.camera is not None:
        conjunction, sentence = "and" if record.camera.is_kept else "but", kept_sentence(record.camera)
        sentences.append(f"The intrinsics were estimated together with the pose, {conjunction} {sentence}.")
    if record.clock is not None:
        sentence = clock_sentence(record.clock, is_trusted=record.is_believed)
        sentences.append(f"{sentence[:1].upper()}{sentence[1:]}.")
    return sentences


def frame_sentences(
    offsets: FrameOffsets, names: Sequence[str], num_parts: int, *, is_multimodal: bool = False
) -> list[str]:
    """Describe how far the poses of single frames lie from what their part of the drive fits.

    Where the information has many maxima, that of a single frame often reaches another one, beyond its interval.
    """
    is_determined, is_within = offsets.is_determined, offsets.is_within
    sentences, fitted = [], "the result"
    if num_parts:
        fitted = "the pose of their part"
        sentences.append(
            f"The frames fit {num_parts} poses: the dashed steps show those of the parts of the drive."
        )
    if is_determined.any():
        residuals = (offsets.offsets - offsets.of_parts)[is_determined]
        scatter = np.sqrt((residuals**2).mean(axis=0))
        far_cm, far_deg = 100.0 * float(np.linalg.norm(scatter[:3])), float(np.linalg.norm(scatter[3:]))
        scattered = f"scatter around {fitted} by {figure(far_cm)} cm and {figure(far_deg)} degrees"
        outliers = np.flatnonzero(is_determined & ~is_within.all(axis=1)).tolist()
        which = f" The others belong to {listed(names[frame] for frame in outliers)}." if outliers else ""
        if is_multimodal:
            sentences.append(
                f"The frames {scattered}. By this cue, a single frame often fits another pose best, beyond its bars: "
                "that is normal, and why frames are combined."
            )
        else:
            sentences.append(
                f"{int(is_within.sum())} of {6 * int(is_determined.sum())} intervals contain {fitted}, and the frames "
                f"{scattered}.{which}"
            )
    if not num_parts and is_determined.sum() > 1:
        sentences.append(
            "Single frames may scatter widely: the result rests on all, and is known far better."
        )
    if not is_determined.all():
        undetermined = listed(names[frame] for frame in np.flatnonzero(~is_determined).tolist())
        sentences.append(f"Frames whose own labels do not determine a pose: {undetermined}.")
    return sentences


def runner_up_sentences(record: CalibrationDocument) -> list[str]:
    """State how much worse the best other mounting was in the search; empty without another one.

    Where that speaks against the pose, it is a reason with its limit.
    """
    margin = record.quality.runner_up_margin
    if margin is None:
        return []
    less = "less" if margin >= 0.0 else "more"
    sentence = (
        f"In the search, the best other mounting had {abs(margin):.1f} standard errors {less} information."
    )
    if policy_of(cues_of_options(record.settings.options)).starts is None:
        return [sentence]
    return [
        f"{sentence} Where that leaves a doubt, both mountings are refined, and the refined poses decide."
    ]


def polish_sentences(record: CalibrationDocument) -> list[str]:
    """Describe what the polish gained on data that it did not use, and what loss is allowed; empty without a polish."""
    if record.polish is None:
        return []
    gain = _held_out(record, 1.0)
    told = f"({gain or 'standard error unknown'})"
    decision = "kept" if record.polish.accepted else "not kept"
    if record.polish.accepted and record.polish.held_out_gain_nats >= 0.0:
        return [f"The polish was {decision}: held-out data gained information {told}."]
    is_multimodal = policy_of(cues_of_options(record.settings.options)).starts is not None
    most = PolishConfig.max_loss_of_tops if is_multimodal else PolishConfig.max_loss
    allowed = f", of which {most:g} standard errors are allowed" if gain else ""
    because = ", since these data took part in the choice of the maximum" if gain and is_multimodal else ""
    return [f"The polish was {decision}: held-out data lost information {told}{allowed}{because}."]


def stage_nats(record: CalibrationDocument, stage: str) -> str:
    """Format the information after a stage; a dash where it is of other cues than that of the result."""
    is_of_others = policy_of(cues_of_options(record.settings.options)).searched_by is not None
    if stage == "initial" and is_of_others:
        return "-"
    return f"{record.stages[stage].mutual_information_nats:.4f}"


def _why_unknown(record: CalibrationDocument) -> str:
    polish = record.polish
    if polish is None:
        return "the pose was not polished"
    if "fused" in record.stages or polish.accepted:
        return "the labels do not determine the pose"
    lost = _held_out(record, -1.0)
    by = f", by {lost}" if lost else ""
    return f"held-out data agree worse after the polish{by}, so the pose before it was kept"


def _held_out(record: CalibrationDocument, sign: float) -> str:
    """Return the gain of the polish on held-out data with its standard error; empty if that is unknown."""
    assert record.polish is not None
    sigma = record.polish.held_out_sigma_nats
    unit = policy_of(cues_of_options(record.settings.options)).unit
    gain = sign * record.polish.held_out_gain_nats
    return "" if sigma is None else f"{gain:.4f} +- {sigma:.4f} {unit}"
