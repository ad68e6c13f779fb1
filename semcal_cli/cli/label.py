"""`semcal label`: labels of pictures and sweeps from networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, get_args

import click

from semcal_cli.cli.options import (
    PATH,
    Command,
    choice_option,
    max_points_option,
    number_option,
    quiet_option,
    threads_option,
    with_options,
)
from semcal_cli.cli.rules import CheckedCommand, given, one_of
from semcal_cli.config import Device

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.labelling.pictures import PictureLabeller
    from semcal_cli.labelling.sides import Side


@dataclass(frozen=True)
class ImageLabels:
    """Options about the network that labels pictures."""

    model: Path
    """File of the model."""
    card: str | None
    """Name or file of its card."""
    is_rectified: bool
    """Whether it sees rectified pictures."""


IMAGE_RULES = (given("--image-card", "--rectify").requires("--image-model", "--show"),)
LABEL_RULES = (
    one_of("--image-model", "--point-model", "--points", "--show"),
    given("--points").excludes("--point-model"),
    given("--point-card").requires("--point-model", "--show"),
    given("--preview", "--probabilities").requires(
        "--image-model", "--show", because="these are of pictures"
    ),
    one_of("-o", "--preview", "--show"),
)


def image_options(command: Command) -> Command:
    """Add the options about the network that labels pictures."""
    return with_options(
        command,
        [
            click.option(
                "--image-model",
                type=PATH,
                metavar="FILE",
                help="Network that labels the pictures, .onnx.",
            ),
            click.option(
                "--image-card",
                metavar="NAME|FILE",
                help="What the network wants and gives: a ready card, as segformer-cityscapes, or a file; "
                "FILE.yaml beside FILE.onnx if not given.",
            ),
            click.option(
                "--rectify",
                is_flag=True,
                help="Let the network see pictures without the lens's distortion, several of a fisheye's, and carry "
                "its labels back.",
            ),
        ],
    )


def image_labels_of(options: Mapping[str, Any]) -> ImageLabels | None:
    """Tell by a command's options which network labels pictures; None if none does."""
    model, card, is_rectified = (options[name] for name in ("image_model", "image_card", "rectify"))
    return None if model is None else ImageLabels(model, card, is_rectified)


def label_on_the_way(
    drive: Path, labels: ImageLabels, max_frames: int, max_points: int, terminal: Terminal
) -> Path:
    """Label evenly spaced pictures of a drive into a cache beside it, and return the drive.yaml of the labelled drive.

    Raises:
        InputError: the model or the card is wrong, or a picture cannot be labelled.
    """
    from semcal_cli.drive.document import read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.labelling.drives import label_beside
    from semcal_cli.labelling.sides import picture_side

    start, whole = perf_counter(), read_drive(drive, max_points)
    chosen = whole.model_copy(update={"frames": tuple(evenly_spaced(whole.frames, max_frames))})
    labeller = _picture_labeller(chosen, labels, "cpu", None)
    path = label_beside(chosen, picture_side(labeller), terminal.on_event)
    seconds = perf_counter() - start
    terminal.print(
        f"labels   {seconds:6.2f} s   {len(chosen.frames)} pictures by {labels.model.name}, in {path}"
    )
    _tell_guesses(labeller, terminal)
    return path


def _check_png(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() != ".png":
        raise click.BadParameter(f"found {path}, needed a .png.", ctx, param)
    return path


@click.command(
    cls=CheckedCommand, rules=(*IMAGE_RULES, *LABEL_RULES), context_settings={"max_content_width": 100}
)
@click.argument("drive", type=PATH, required=False)
@image_options
@click.option(
    "--probabilities", is_flag=True, help="Write probabilities of classes, .npz, instead of ids, .png."
)
@click.option(
    "--point-model", type=PATH, metavar="FILE", help="Network that labels the range images of sweeps, .onnx."
)
@click.option(
    "--point-card",
    metavar="NAME|FILE",
    help="What it wants and gives; FILE.yaml beside FILE.onnx if not given.",
)
@click.option(
    "--points",
    type=click.Choice(["segments"]),
    help="Label the points by their geometry instead: ground and objects, each with the number of its segment.",
)
@click.option(
    "-o", "--output", type=PATH, metavar="DRIVE", help="Folder of the labelled drive, or its drive.yaml."
)
@click.option(
    "--preview", type=PATH, callback=_check_png, metavar="FILE", help="Draw the labels of one picture, .png."
)
@click.option(
    "--show", type=PATH, metavar="FILE", help="Tell what was understood of a model, and try it; no drive."
)
@number_option("--max-frames", help="Label at most N evenly spaced frames; all if not given.")
@choice_option("--device", get_args(Device), default="cpu", help="Device of the networks.")
@click.option("--force", is_flag=True, help="Make labels again that are there.")
@max_points_option
@threads_option
@quiet_option
def label(drive: Path | None, **options: Any) -> None:
    """Label the pictures or the sweeps of DRIVE with networks, and write a drive with the labels.

    A network is an ONNX file. What it wants is read from it and from its card; what neither says is guessed, and told.
    A stopped run goes on where it was. A frame that cannot be labelled is named and left out; the exit code is then 1.
    """
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.threads import set_num_threads

    set_num_threads(options["threads"])
    with Terminal(quiet=options["quiet"]) as terminal:
        if options["show"] is not None:
            _show(options["show"], options)
            return
        if drive is None:
            raise click.UsageError("Missing argument 'DRIVE'.")
        _label_drive(drive, options, terminal)


def _show(model: Path, options: dict[str, Any]) -> None:
    from semcal_cli.labelling.network import open_network
    from semcal_cli.labelling.pictures import describe_model

    card = options["image_card"] or options["point_card"]
    for name, text in describe_model(open_network(model, options["device"], options["threads"]), card):
        click.echo(f"{name:<10}{text}")


def _label_drive(path: Path, options: dict[str, Any], terminal: Terminal) -> None:
    """Label a drive, draw the preview, and say what was done.

    Raises:
        InputError: the drive, a model or a card is wrong, or frames cannot be labelled.
    """
    from semcal_cli.drive.document import read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.errors import InputError
    from semcal_cli.labelling.drives import label_drive
    from semcal_cli.labelling.sides import picture_side

    images = image_labels_of(options)
    drive = read_drive(path, options["max_points"])
    num_frames = len(drive.frames)
    indices = evenly_spaced(range(num_frames), options["max_frames"] or num_frames)
    sides = []
    if images is not None:
        labeller = _picture_labeller(drive, images, options["device"], options["threads"])
        _tell_guesses(labeller, terminal)
        if options["preview"] is not None:
            _preview(drive, labeller, options["preview"], terminal)
        sides.append(picture_side(labeller, has_probabilities=options["probabilities"]))
    sides += _point_sides(options)
    if options["output"] is None:
        return
    start = perf_counter()
    done = label_drive(
        drive,
        sides,
        options["output"],
        indices=indices,
        force=options["force"],
        on_event=terminal.on_event,
    )
    before = f", {done.num_before:,} label files were there" if done.num_before else ""
    terminal.print(f"wrote {done.path}: {done.num_frames:,} frames in {perf_counter() - start:.1f} s{before}")
    for failure in done.failures:
        terminal.print(f"failed: {failure}")
    if done.failures:
        raise InputError(f"{len(done.failures)} of {len(indices)} frames failed; {done.failures[0]}")


def _picture_labeller(
    drive: Drive, labels: ImageLabels, device: str, num_threads: int | None
) -> PictureLabeller:
    from semcal_cli.labelling.model import picture_model
    from semcal_cli.labelling.network import open_network
    from semcal_cli.labelling.pictures import PictureLabeller

    model = picture_model(open_network(labels.model, device, num_threads), labels.card)
    return PictureLabeller(model, drive.camera, is_rectified=labels.is_rectified)


def _point_sides(options: dict[str, Any]) -> list[Side]:
    from semcal_cli.labelling.model import point_model
    from semcal_cli.labelling.network import open_network
    from semcal_cli.labelling.sides import segment_side, sweep_side
    from semcal_cli.labelling.sweeps import SweepLabeller

    if options["points"] is not None:
        return [segment_side()]
    if options["point_model"] is None:
        return []
    network = open_network(options["point_model"], options["device"], options["threads"])
    return [sweep_side(SweepLabeller(point_model(network, options["point_card"])))]


def _tell_guesses(labeller: PictureLabeller, terminal: Terminal) -> None:
    for guess in labeller.model.guesses:
        terminal.print(f"guessed: {guess}")


def _preview(drive: Drive, labeller: PictureLabeller, path: Path, terminal: Terminal) -> None:
    """Draw the labels of the middle frame."""
    from semcal_cli.drive.reading import read_frame_image
    from semcal_cli.errors import InputError
    from semcal_cli.files.images import write_image
    from semcal_cli.report.label_picture import draw_labels

    frame = drive.frames[len(drive.frames) // 2]
    picture = read_frame_image(drive, frame)
    if picture is None:
        raise InputError(f"{drive.path}: {frame.key('image')}: found nothing, needed a picture")
    model = labeller.model
    write_image(draw_labels(picture, labeller.ids(picture), model.classes, model.ignore), path)
    terminal.print(f"drew {path}: {frame.image}")
