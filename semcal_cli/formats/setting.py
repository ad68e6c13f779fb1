"""Intrinsics and a clock that are set in a file of the user's.

The camera must be the one of the file, and what was set is said.
"""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.lenses import pixels_of
from semcal_cli.result.camera_words import offset_words


def check_size(options: FormatOptions, camera: Camera, sides: Sequence[object]) -> None:
    """Check that a file is of pictures of the camera's size.

    Args:
        options: Options with the file.
        camera: The camera.
        sides: Width and height in the file.

    Raises:
        InputError: the file is of pictures of another size.
    """
    if list(sides) != [camera.width, camera.height]:
        known = [describe(side) for side in sides if side is not None]
        found = f"pictures of {' x '.join(known)} pixels" if known else "no size of pictures"
        raise InputError(
            f"{options.file}: found {found}, needed {camera.width} x {camera.height}: the camera "
            "that was estimated with the transform is of those; --to semcal writes the transform alone"
        )


def tell(options: FormatOptions, camera: Camera) -> None:
    """Say that the intrinsics were set, with focal lengths and principal point."""
    if options.on_note is not None:
        pixels = zip(("fx", "fy", "cx", "cy"), pixels_of(camera), strict=True)
        figures = ", ".join(f"{name} {value:.6g}" for name, value in pixels)
        options.on_note(f"set the intrinsics in {options.file}: {figures}")


def tell_clock(options: FormatOptions, *, is_set: bool) -> None:
    """Say whether the offset of the camera's clock was set, if there is one."""
    if options.time_offset_s is None or options.on_note is None:
        return
    offset = offset_words(options.time_offset_s)
    if is_set:
        options.on_note(f"set the clock in {options.file}: {offset}")
    else:
        options.on_note(f"left out the clock, which {options.file} has no place for: {offset}")
