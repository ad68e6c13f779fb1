"""`semcal label`: labels of images and sweeps from networks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import click

from semcal_cli.cli.image_networks import ImageSettings
from semcal_cli.cli.options import ThreadSettings, max_points
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import argument, option
from semcal_cli.cli.settings_command import command
from semcal_cli.config import Device

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.labelling.image_labeller import ImageLabeller
    from semcal_cli.labelling.sides import LabelSide

NAME_WIDTH = 12
"""Columns of the short names in the table of networks."""
SHOW_WIDTH = 10
"""Columns of the labels of `--show`."""


def _list_models(ctx: click.Context, param: click.Parameter, lists_models: bool) -> bool:
    if lists_models and not ctx.resilient_parsing:
        from semcal_cli.cli.tables import wrapped
        from semcal_cli.labelling.hub import PREFIX, RECOMMENDED

        for name, network in RECOMMENDED.items():
            texts = (
                f"{network.megabytes} MB, {network.classes}",
                f"{PREFIX}{network.repository}",
                network.licence,
            )
            for label, text in zip((name, "", ""), texts, strict=True):
                click.echo("\n".join(wrapped(label, text, NAME_WIDTH)))
        ctx.exit()
    return lists_models


def _check_png(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() != ".png":
        raise click.BadParameter(f"found {path}, expected a .png.", ctx, param)
    return path


@dataclass(frozen=True, kw_only=True)
class LabelSettings(ImageSettings, ThreadSettings):
    """Settings of `label`."""

    rules = [
        one_of("--image-model", "--point-model", "--points", "--show", "--download"),
        given("--points").excludes("--point-model"),
        given("--point-card").requires("--point-model", "--show"),
        given("--preview", "--probabilities").requires("--image-model", "--show", because="it is for images"),
        one_of("-o", "--preview", "--show", "--to"),
        given("--show", "--download").excludes(
            *("--image-model", "--point-model", "--points", "--preview", "-o"), because="it labels nothing"
        ),
        given("--download").requires("--to"),
        given("--to").requires("--download"),
    ]
    drive: Path | None = argument()
    probabilities: bool = option("Write class probabilities (.npz) instead of ids (.png).", default=False)
    point_model: Path | None = option(
        "Network that labels sweeps, as range images or as points, .onnx.", metavar="FILE"
    )
    point_card: str | None = option(
        "Model card of --point-model. Default: FILE.yaml next to FILE.onnx.", metavar="NAME|FILE"
    )
    points: Literal["segments"] | None = option(
        "Label the points by geometry instead: ground or object, and the number of the segment."
    )
    output: Path | None = option(
        "Folder for the labelled drive, or its drive.yaml.", "-o", "--output", metavar="DRIVE"
    )
    preview: Path | None = option(
        "Draw the middle image and its labels by the (first) network, .png.",
        callback=_check_png,
        metavar="FILE",
    )
    show: str | None = option(
        "Print how semcal interprets a network, and try it. Needs no drive.", metavar="FILE|NAME"
    )
    download: str | None = option(
        "Fetch a network from the hub, for a machine without a connection. Needs no drive.", metavar="NAME"
    )
    to: Path | None = option("Folder for what --download fetches.", metavar="DIR")
    list_models: bool = option(
        "List the networks with short names, and exit.", default=False, is_eager=True, callback=_list_models
    )
    max_frames: int | None = option("Label at most N evenly spaced frames. Default: all.", minimum=1)
    device: Device = option("Device that runs the networks.", default="cpu")
    force: bool = option("Replace existing labels.", default=False)
    max_points: int = max_points()


@command(LabelSettings, context_settings={"max_content_width": 100})
def label(settings: LabelSettings) -> None:
    """Label the images or the sweeps of DRIVE with networks, and write a drive with the labels.

    A network is an ONNX file or the name of one on the Hugging Face hub. Its input and output are read from the file
    and from its model card, or from the transformers files next to it. Anything that none of them states is guessed,
    and each guess is printed.

    A second --image-model is written to drive_2.yaml, and the share of pixels on which the two differ is printed.

    A run that was stopped continues where it left off. Frames that cannot be labelled are reported and left out; the
    exit code is then 1.
    """
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.errors import InputError, shell
    from semcal_cli.files.input_files import is_folder, kind_of
    from semcal_cli.labelling.hub import copy_network, find_model
    from semcal_cli.labelling.image_labeller import describe_model
    from semcal_cli.labelling.onnx_network import open_network
    from semcal_cli.threads import set_num_threads

    set_num_threads(settings.threads)
    with settings.terminal() as terminal:
        if settings.show is not None:
            path = find_model(settings.show, settings.max_download_mb, terminal.on_event)
            network = open_network(path, settings.device, settings.threads)
            for name, text in describe_model(network, settings.image_card or settings.point_card):
                click.echo("\n".join(wrapped(name, text, SHOW_WIDTH)))
            return
        if settings.download is not None and settings.to is not None:
            if settings.drive is not None:
                raise click.UsageError("--download takes no DRIVE: it labels nothing.")
            if (kind := kind_of(settings.to)) is not None and not is_folder(settings.to):
                raise InputError(f"{settings.to}: found {kind}, expected a folder")
            model = find_model(settings.download, settings.max_download_mb, terminal.on_event)
            copy = copy_network(model, settings.to)
            offline = shell("label", "DRIVE", "--image-model", copy, "-o", "labelled")
            terminal.print(f"wrote {copy}", f"offline: {offline}")
            return
        if settings.drive is None:
            raise click.UsageError("Missing argument 'DRIVE'.")
        _label_drive(settings.drive, settings, terminal)


def _label_drive(path: Path, settings: LabelSettings, terminal: Terminal) -> None:
    """Label a drive, draw the preview, and report what was done."""
    from semcal_cli.drive.document import output_drive_file, read_drive
    from semcal_cli.errors import InputError, counted, shell
    from semcal_cli.labelling.labelled_drive import label_drive
    from semcal_cli.labelling.second_labels import record_second_labels, second_file
    from semcal_cli.observations.frame_selection import evenly_spaced

    drive = read_drive(path, settings.max_points)
    num_frames = len(drive.frames)
    indices = evenly_spaced(range(num_frames), settings.max_frames or num_frames)
    point_sides, image_sides = _point_sides(settings), _image_sides(drive, settings, terminal)
    if settings.output is None:
        return
    start, path = perf_counter(), output_drive_file(settings.output)
    run = partial(label_drive, drive, indices=indices, on_event=terminal.on_event)
    first = [*image_sides[:1], *point_sides]
    done = run(first, path, overwrite=first if settings.force else ())
    failures = dict.fromkeys(done.failures)
    for side in image_sides[1:]:
        # The sweeps have their labels already.
        second = run([side, *point_sides], second_file(path), overwrite=[side] if settings.force else ())
        failures |= dict.fromkeys(second.failures)
        terminal.print(record_second_labels(path, second.path).sentence)
    reused = f", {done.num_before:,} label files reused" if done.num_before else ""
    terminal.print(
        f"wrote {done.path}: {counted(done.num_frames, 'frame')} in {perf_counter() - start:.1f} s{reused}",
        *(f"failed: {failure}" for failure in failures),
    )
    if failures:
        raise InputError(f"{len(failures)} of {len(indices)} frames failed; {next(iter(failures))}")
    terminal.print(f"next: {shell('calibrate', settings.output, '-o', 'calibration.yaml')}")


def _image_sides(drive: Drive, settings: LabelSettings, terminal: Terminal) -> list[LabelSide]:
    """Open the image networks, and draw the preview of the first."""
    from semcal_cli.labelling.sides import image_side

    labellers = settings.image_labellers(drive, terminal, settings.device, settings.threads)
    if settings.preview is not None and labellers:
        _preview(drive, labellers[0], settings.preview, terminal)
    sides = [
        image_side(labeller, drive.image_levels, has_probabilities=settings.probabilities)
        for labeller in labellers
    ]
    return [*sides[:1], *(replace(side, folder=f"{side.key}_2") for side in sides[1:])]


def _point_sides(settings: LabelSettings) -> list[LabelSide]:
    from semcal_cli.labelling.onnx_network import open_network
    from semcal_cli.labelling.sides import segment_side, sweep_side
    from semcal_cli.labelling.sweep_labeller import sweep_labeller

    if settings.points is not None:
        return [segment_side()]
    if settings.point_model is None:
        return []
    network = open_network(settings.point_model, settings.device, settings.threads)
    return [sweep_side(sweep_labeller(network, settings.point_card))]


def _preview(drive: Drive, labeller: ImageLabeller, path: Path, terminal: Terminal) -> None:
    """Draw the labels of the middle frame."""
    from semcal_cli.files.image_files import write_image
    from semcal_cli.observations.reading import read_needed_image
    from semcal_cli.report.overlays import draw_labels

    frame = drive.frames[len(drive.frames) // 2]
    image = read_needed_image(drive, frame)
    model = labeller.model
    write_image(draw_labels(image, labeller.ids(image), model.classes, model.ignore), path)
    terminal.print(f"drew {path}: {frame.image}")
