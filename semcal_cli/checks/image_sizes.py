"""Whether images have the size of the camera's images."""

from __future__ import annotations

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import read_image, read_size
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
"""Number of images whose sizes are checked."""


def check_image_sizes(drive: Drive) -> list[str]:
    """Check that some images can be read and have the size of the camera's images."""
    named = [frame.image for frame in drive.frames if frame.image is not None]
    sentences, (needed_width, needed_height) = [], drive.camera.size
    for name in evenly_spaced(named, NUM_PROBED):
        try:
            width, height = read_size(drive.resolve(name))
            if (width, height) == drive.camera.size:
                read_image(drive.resolve(name), drive.camera.size)
                continue
            finding = IMAGE_SIZE.finding(
                f"{name} is {width} x {height}, the camera's images are {needed_width} x {needed_height}"
            )
            sentences.append(finding.sentence)
        except InputError as error:
            sentences.append(str(error))
    return sentences
