"""Options for the networks that label images, and labels on the way to a calibration."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import option
from semcal_cli.config import Device

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.labelling.image_labeller import ImageLabeller

MAX_NETWORKS = 2
"""Largest number of networks that label the same images."""


def _check_pair(ctx: click.Context, param: click.Parameter, names: tuple[str, ...]) -> tuple[str, ...]:
    if len(names) > MAX_NETWORKS:
        raise click.BadParameter(f"found {len(names)}, needed at most {MAX_NETWORKS}.", ctx, param)
    if len({*map(os.path.abspath, names)}) < len(names):  # it would agree with itself
        raise click.BadParameter(f"found {names[0]} twice, expected two networks.", ctx, param)
    return names


@dataclass(frozen=True, kw_only=True)
class ImageSettings:
    """Options for the networks that label images."""

    section = "Image labels"
    rules = [given("--image-card", "--rectify").requires("--image-model", "--show")]
    image_model: tuple[str, ...] = option(
        "Network that labels the images: an .onnx file, hf:OWNER/NAME[@REVISION][:FILE] on the Hugging Face hub, or "
        "a short name such as cityscapes. Give the option twice to compare a second network with the first, whose "
        "labels are used.",
        metavar="FILE|NAME",
        multiple=True,
        callback=_check_pair,
        default=(),
        brief="Label the images by this network: an .onnx file, or a name of `label --list-models`.",
    )
    image_card: str | None = option(
        "Model card, which describes the input and output of the (first) network: the name of a ready card, such as "
        "segformer-cityscapes, or a file. Default: FILE.yaml next to FILE.onnx.",
        metavar="NAME|FILE",
    )
    max_download_mb: int = option(
        "Largest download from the hub, in megabytes.", default=500, minimum=1, metavar="MB"
    )
    rectify: bool = option(
        "Show the network images without lens distortion (several for a fisheye), and map its labels back.",
        default=False,
    )

    def image_labellers(
        self, drive: Drive, terminal: Terminal, device: Device = "cpu", num_threads: int | None = None
    ) -> list[ImageLabeller]:
        """Open the networks, and print what was guessed about them.

        Raises:
            InputError: a model or the card is wrong.
        """
        from semcal_cli.labelling.hub import find_model
        from semcal_cli.labelling.image_labeller import ImageLabeller
        from semcal_cli.labelling.model import image_model
        from semcal_cli.labelling.onnx_network import open_network

        labellers: list[ImageLabeller] = []
        for name in self.image_model:
            path = find_model(name, self.max_download_mb, terminal.on_event)
            card = None if labellers else self.image_card
            model = image_model(open_network(path, device, num_threads), card)
            terminal.print(*(f"guessed: {guess}" for guess in model.guesses))
            if model.licence is not None:
                terminal.print(f"licence of {path.name}: {model.licence}")
            labellers.append(ImageLabeller(model, drive.camera, is_rectified=self.rectify))
        return labellers


def label_on_the_way(drive: Drive, images: ImageSettings, max_frames: int, terminal: Terminal) -> Path:
    """Label evenly spaced images of a drive into a cache beside it.

    Returns:
        The drive.yaml with the labels of the first network.

    Raises:
        InputError: a model or the card is wrong, an image cannot be labelled, or a calibration would refuse the point
            times.
    """
    from semcal_cli.errors import counted
    from semcal_cli.labelling.labelled_drive import label_beside
    from semcal_cli.labelling.sides import image_side
    from semcal_cli.observations.frame_selection import with_few_frames
    from semcal_cli.observations.point_times import checked_times
    from semcal_cli.observations.reading import read_clouds

    start, chosen = perf_counter(), with_few_frames(drive, max_frames)
    if drive.motion is not None:
        # All sweeps tell in which unit their times are, and the labelled drive has only the chosen ones.
        (cloud,) = read_clouds(first := with_few_frames(drive, 1))
        checked_times(first, first.frames[0], cloud, drive.motion.point_times)
    sides = [
        image_side(labeller, chosen.image_levels) for labeller in images.image_labellers(chosen, terminal)
    ]
    path, second = label_beside(chosen, sides, terminal.on_event)
    names = " and ".join(Path(name).name for name in images.image_model)
    did = f"{counted(len(chosen.frames), 'image')} by {names}, in {path}"
    terminal.print(f"labels   {perf_counter() - start:6.2f} s   {did}")
    if second is not None:
        terminal.print(second.sentence)
    return path
