"""The camera and the clock that were estimated together with a pose, in words."""

from __future__ import annotations

from typing import NamedTuple

from semcal_cli.drive.camera import Camera, without_last_zeros
from semcal_cli.result.camera import Clock, Intrinsic, RefinedCamera
from semcal_cli.result.intervals import figure

IN_PIXELS = ("fx", "fy", "cx", "cy")
"""Intrinsics that are lengths in the picture; the others have no unit."""
OF_DRIVE = "the transform belongs to the camera of the drive"


class IntrinsicText(NamedTuple):
    """An intrinsic as text, with its unit."""

    name: str
    given: str
    found: str
    half_width: str
    """Half width of the 95 % interval; empty where the data do not determine the intrinsic."""
    is_determined: bool


def intrinsic_texts(camera: RefinedCamera) -> list[IntrinsicText]:
    """Write each intrinsic that was estimated, to two significant digits of its interval."""
    return [_text(name, each) for name, each in camera.intrinsics.items()]


def _text(name: str, each: Intrinsic) -> IntrinsicText:
    unit = " px" if name in IN_PIXELS else ""
    if not each.is_determined or each.half_width_95 is None:
        given, found = f"{each.given:.6g}{unit}", f"{each.found:.6g}{unit}"
        return IntrinsicText(name, given, found, "", is_determined=False)
    half = figure(each.half_width_95)
    digits = len(half.partition(".")[2])
    rounded = (round(value, digits) + 0.0 for value in (each.given, each.found))  # no -0.0000
    given, found = (f"{value:.{digits}f}{unit}" for value in rounded)
    return IntrinsicText(name, given, found, half + unit, is_determined=True)


def intrinsic_lines(camera: RefinedCamera) -> list[str]:
    """List the intrinsics with their intervals, and say last whether they are kept."""
    lines = []
    for each in intrinsic_texts(camera):
        found, _, unit = each.found.partition(" ")
        if each.is_determined:
            half, given = (text.partition(" ")[0] for text in (each.half_width, each.given))
            lines.append(f"{each.name} {' '.join([found, '+-', half, unit]).strip()} (drive: {given})")
        else:
            lines.append(f"{each.name} not determined: it stays at {each.given}")
    return [*lines, kept_sentence(camera)]


def intrinsic_changes(camera: RefinedCamera) -> list[str]:
    """List the intrinsics that are determined: their values by the drive, and those that were found."""
    texts = [each for each in intrinsic_texts(camera) if each.is_determined]
    return [f"{each.name} {each.given.partition(' ')[0]} -> {each.found.partition(' ')[0]}" for each in texts]


def kept_sentence(camera: RefinedCamera) -> str:
    """Say whether the transform belongs to the found intrinsics, and what held-out data say of them."""
    sigma = camera.held_out_sigma_nats
    gain = f"{camera.held_out_gain_nats:.4f}{'' if sigma is None else f' +- {sigma:.4f}'} nats"
    if camera.is_kept:
        return f"kept: on data that was held out they gain {gain}"
    if not any(each.is_determined for each in camera.intrinsics.values()):
        return f"not kept: the data determine none of them; {OF_DRIVE}"
    return f"not kept: on data that was held out they gain {gain}; {OF_DRIVE}"


def clock_sentence(clock: Clock) -> str:
    """Say how far the clock of the pictures is off, with the 95 % interval."""
    if not clock.is_determined or clock.half_width_95_s is None:
        return clock.meaning
    interval = f"{clock.meaning}, +- {figure(1000.0 * clock.half_width_95_s)} ms"
    return interval if clock.is_kept else f"{interval}; not kept: the transform belongs to the drive's stamps"


def offset_words(time_offset_s: float) -> str:
    """Say by how much pictures are later or earlier than their stamps say."""
    if time_offset_s == 0.0:
        return "stamps of pictures are right"
    side = "later" if time_offset_s > 0.0 else "earlier"
    return f"pictures are {1000.0 * abs(time_offset_s):.1f} ms {side} than their stamps say"


def camera_differences(found: Camera, other: Camera, whose: str) -> list[str]:
    """List what a camera has that another one has not; how well it is known makes it no other one.

    Args:
        found: The camera.
        other: The other camera.
        whose: Name of the other one, which stands beside its figures.
    """
    pairs = zip(IN_PIXELS, _pixels(found), _pixels(other), strict=True)
    differences = [f"{name} {a:.6g} ({whose}: {b:.6g})" for name, a, b in pairs if a != b]
    names = [name for name in Camera.model_fields if name not in ("K", "intrinsics_sigma")]
    a, b = map(without_last_zeros, (found, other))
    return differences + [f"another {name}" for name in names if getattr(a, name) != getattr(b, name)]


def _pixels(camera: Camera) -> tuple[float, float, float, float]:
    (fx, _, cx), (_, fy, cy), _ = camera.K
    return fx, fy, cx, cy
