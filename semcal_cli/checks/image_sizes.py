"""Whether images have the size of the camera's images."""

from __future__ import annotations

from collections import defaultdict

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import Size, read_image, read_size
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.observations.frame_selection import evenly_spaced

IMAGE_SIZE = Check(
    topic="image-size",
    entry=Entry(
        title="Images have another size",
        section=PageSection.INSPECTION,
        quotes=("images/000000.png is 1920 x 1080, the camera's images are 1280 x 720",),
        meaning="An image has another size than `camera:` says, so that K does not belong to it.",
        cause="Images were resized or cropped after the calibration of the lens, or K is that of another camera.",
        remedy="Give K, `width` and `height` for the images as they are, or name the original images.",
    ),
)
NUM_PROBED = 4
"""Number of images that are decoded, and largest number of images whose errors are listed."""


def check_image_sizes(drive: Drive) -> list[str]:
    """Check that images have the size of the camera's images, by their headers, and that some can be decoded."""
    named = list(dict.fromkeys(frame.image for frame in drive.frames if frame.image is not None))
    decoded = {*evenly_spaced(named, NUM_PROBED)}
    by_size, errors = defaultdict[Size, list[str]](list), list[str]()
    for name in named:
        try:
            size = read_size(drive.resolve(name))
            if size != drive.camera.size:
                by_size[size].append(name)
            elif name in decoded:
                read_image(drive.resolve(name), size)
        except InputError as error:
            errors.append(str(error))
    needed_width, needed_height = drive.camera.size
    sentences = []
    for (width, height), names in by_size.items():
        which = f"{names[0]} is" if len(names) == 1 else f"{names[0]} and {len(names) - 1:,} more are"
        finding = IMAGE_SIZE.finding(
            f"{which} {width} x {height}, the camera's images are {needed_width} x {needed_height}"
        )
        sentences.append(finding.sentence)
    if len(errors) > NUM_PROBED:
        errors[NUM_PROBED:] = [f"{len(errors) - NUM_PROBED:,} more images cannot be read"]
    return [*sentences, *errors]
