"""`semcal label`: labels of images and sweeps from networks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import click

from semcal_cli.cli.options import ThreadSettings, max_points
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import argument, command, option
from semcal_cli.config import Device

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.labelling.images import ImageLabeller
    from semcal_cli.labelling.sides import Side


MOST_NETWORKS = 2
"""Most networks that label the same images."""


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """Options about networks that label images."""

    section = "Image labels"
    rules = [given("--image-card", "--rectify").requires("--image-model", "--show")]
    image_card: str | None = option(
        "What the network wants and gives: a ready card, as segformer-cityscapes, or a file; FILE.yaml beside "
        "FILE.onnx if not given.",
        metavar="NAME|FILE",
    )
    max_download_mb: int = option(
        "Fetch at most this from the hub, in megabytes.", default=500, least=1, metavar="MB"
    )
    rectify: bool = option(
        "Let the network see images without the lens's distortion, several of a fisheye's, and carry its labels "
        "back.",
        default=False,
    )

    def image_labeller(
        self,
        drive: Drive,
        name: str,
        terminal: Terminal,
        device: Device = "cpu",
        num_threads: int | None = None,
        *,
        card: str | None = None,
    ) -> ImageLabeller:
        """Open the network, and tell what had to be guessed of it.

        Raises:
            InputError: the model or the card is wrong.
        """
        from semcal_cli.labelling.hub import find_model
        from semcal_cli.labelling.images import ImageLabeller
        from semcal_cli.labelling.model import picture_model
        from semcal_cli.labelling.network import open_network

        path = find_model(name, self.max_download_mb, terminal.on_event)
        model = picture_model(open_network(path, device, num_threads), card)
        terminal.print(*(f"guessed: {guess}" for guess in model.guesses))
        if model.licence is not None:
            terminal.print(f"licence of {path.name}: {model.licence}")
        return ImageLabeller(model, drive.camera, is_rectified=self.rectify)


@dataclass(frozen=True, kw_only=True)
class ImageSettings(NetworkSettings):
    """Options about the network that labels images."""

    image_model: str | None = option(
        "Network that labels the images: an .onnx file, hf:OWNER/NAME[@REVISION][:FILE] of the Hugging Face hub, or "
        "a short name, as cityscapes.",
        metavar="FILE|NAME",
    )


def label_on_the_way(
    drive: Path, images: ImageSettings, max_frames: int, max_points: int, terminal: Terminal
) -> Path:
    """Label evenly spaced images of a drive into a cache beside it, and return the drive.yaml of the labelled drive.

    Raises:
        InputError: the model or the card is wrong, or an image cannot be labelled.
    """
    from semcal_cli.drive.document import read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.labelling.drives import label_beside
    from semcal_cli.labelling.sides import picture_side

    start, whole = perf_counter(), read_drive(drive, max_points)
    chosen = whole.model_copy(update={"frames": tuple(evenly_spaced(whole.frames, max_frames))})
    assert images.image_model is not None  # where it is asked for
    labeller = images.image_labeller(chosen, images.image_model, terminal, card=images.image_card)
    path = label_beside(chosen, picture_side(labeller), terminal.on_event)
    did = f"{len(chosen.frames)} images by {Path(images.image_model).name}, in {path}"
    terminal.print(f"labels   {perf_counter() - start:6.2f} s   {did}")
    return path


def _list_models(ctx: click.Context, param: click.Parameter, is_asked: bool) -> bool:
    if is_asked and not ctx.resilient_parsing:
        from semcal_cli.labelling.hub import recommended_lines

        click.echo("\n".join(recommended_lines()))
        ctx.exit()
    return is_asked


def _check_pair(ctx: click.Context, param: click.Parameter, names: tuple[str, ...]) -> tuple[str, ...]:
    if len(names) > MOST_NETWORKS:
        raise click.BadParameter(f"found {len(names)}, needed at most {MOST_NETWORKS}.", ctx, param)
    return names


def _check_png(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() != ".png":
        raise click.BadParameter(f"found {path}, needed a .png.", ctx, param)
    return path


@dataclass(frozen=True, kw_only=True)
class PairSettings(NetworkSettings):
    """Options about one network or two that label images."""

    section = "Image labels"
    image_model: tuple[str, ...] = option(
        "Network that labels the images: an .onnx file, hf:OWNER/NAME[@REVISION][:FILE] of the Hugging Face hub, or "
        "a short name, as cityscapes. A second one, in drive_2.yaml, tells how far to believe the first.",
        metavar="FILE|NAME",
        multiple=True,
        callback=_check_pair,
        default=(),
    )


@dataclass(frozen=True, kw_only=True)
class LabelSettings(PairSettings, ThreadSettings):
    """What the options of `label` say."""

    rules = [
        one_of("--image-model", "--point-model", "--points", "--show"),
        given("--points").excludes("--point-model"),
        given("--point-card").requires("--point-model", "--show"),
        given("--preview", "--probabilities").requires(
            "--image-model", "--show", because="these are of images"
        ),
        one_of("-o", "--preview", "--show"),
    ]
    drive: Path | None = argument()
    probabilities: bool = option("Write probabilities of classes, .npz, instead of ids, .png.", default=False)
    point_model: Path | None = option(
        "Network that labels sweeps by their range images or points, .onnx.", metavar="FILE"
    )
    point_card: str | None = option(
        "What it wants and gives; FILE.yaml beside FILE.onnx if not given.", metavar="NAME|FILE"
    )
    points: Literal["segments"] | None = option(
        "Label the points by their geometry instead: ground and objects, each with the number of its segment."
    )
    output: Path | None = option(
        "Folder of the labelled drive, or its drive.yaml.", "-o", "--output", metavar="DRIVE"
    )
    preview: Path | None = option("Draw the labels of one image, .png.", callback=_check_png, metavar="FILE")
    show: str | None = option(
        "Tell what was understood of a model, and try it; no drive.", metavar="FILE|NAME"
    )
    list_models: bool = option(
        "List the short names of networks, and exit.", default=False, is_eager=True, callback=_list_models
    )
    max_frames: int | None = option("Label at most N evenly spaced frames; all if not given.", least=1)
    device: Device = option("Device of the networks.", default="cpu")
    force: bool = option("Make labels again that are there.", default=False)
    max_points: int = max_points()


@command(LabelSettings, context_settings={"max_content_width": 100})
def label(settings: LabelSettings) -> None:
    """Label the images or the sweeps of DRIVE with networks, and write a drive with the labels.

    A network is an ONNX file, or the name of one on the Hugging Face hub. What it wants is read from it, and from its
    card or the files of transformers beside it; what these do not say is guessed, and told.
    A stopped run goes on where it was. A frame that cannot be labelled is named and left out; the exit code is then 1.
    """
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.labelling.hub import find_model
    from semcal_cli.labelling.images import describe_model
    from semcal_cli.labelling.network import open_network
    from semcal_cli.threads import set_num_threads

    set_num_threads(settings.threads)
    with Terminal(quiet=settings.quiet) as terminal:
        if settings.show is not None:
            path = find_model(settings.show, settings.max_download_mb, terminal.on_event)
            network = open_network(path, settings.device, settings.threads)
            for name, text in describe_model(network, settings.image_card or settings.point_card):
                click.echo(f"{name:<10}{text}")
            return
        if settings.drive is None:
            raise click.UsageError("Missing argument 'DRIVE'.")
        _label_drive(settings.drive, settings, terminal)


def _label_drive(path: Path, settings: LabelSettings, terminal: Terminal) -> None:
    """Label a drive, draw the preview, and say what was done."""
    from semcal_cli.drive.document import output_drive_file, read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.drive.networks import LabelNetworks
    from semcal_cli.errors import InputError
    from semcal_cli.labelling.drives import label_drive
    from semcal_cli.labelling.pairs import note_second, second_file

    drive = read_drive(path, settings.max_points)
    num_frames = len(drive.frames)
    indices = evenly_spaced(range(num_frames), settings.max_frames or num_frames)
    of_points, of_images = _point_sides(settings), _image_sides(drive, settings, terminal)
    if settings.output is None:
        return
    start, path = perf_counter(), output_drive_file(settings.output)
    run = partial(label_drive, drive, indices=indices, force=settings.force, on_event=terminal.on_event)
    done = run([*of_images[:1], *of_points], path)
    failures = dict.fromkeys(done.failures)
    for side in of_images[1:]:
        second = run([side, *of_points], second_file(path))
        failures |= dict.fromkeys(second.failures)
        noted = note_second(path, second.path)
        terminal.print(*(line for line in LabelNetworks(second=noted).describe()))
    before = f", {done.num_before:,} label files were there" if done.num_before else ""
    terminal.print(
        f"wrote {done.path}: {done.num_frames:,} frames in {perf_counter() - start:.1f} s{before}",
        *(f"failed: {failure}" for failure in failures),
    )
    if failures:
        raise InputError(f"{len(failures)} of {len(indices)} frames failed; {next(iter(failures))}")


def _image_sides(drive: Drive, settings: LabelSettings, terminal: Terminal) -> list[Side]:
    """Open the networks of images; the card that is named is that of the first. A preview is of the first, too."""
    from semcal_cli.labelling.sides import picture_side

    sides: list[Side] = []
    for name in settings.image_model:
        card = None if sides else settings.image_card
        labeller = settings.image_labeller(
            drive, name, terminal, settings.device, settings.threads, card=card
        )
        if settings.preview is not None and not sides:
            _preview(drive, labeller, settings.preview, terminal)
        side = picture_side(labeller, has_probabilities=settings.probabilities)
        sides.append(replace(side, folder=f"{side.key}_2") if sides else side)
    return sides


def _point_sides(settings: LabelSettings) -> list[Side]:
    from semcal_cli.labelling.network import open_network
    from semcal_cli.labelling.sides import segment_side, sweep_side
    from semcal_cli.labelling.sweeps import sweep_labeller

    if settings.points is not None:
        return [segment_side()]
    if settings.point_model is None:
        return []
    network = open_network(settings.point_model, settings.device, settings.threads)
    return [sweep_side(sweep_labeller(network, settings.point_card))]


def _preview(drive: Drive, labeller: ImageLabeller, path: Path, terminal: Terminal) -> None:
    """Draw the labels of the middle frame."""
    from semcal_cli.drive.reading import read_needed_image
    from semcal_cli.files.images import write_image
    from semcal_cli.report.overlay import draw_labels

    frame = drive.frames[len(drive.frames) // 2]
    picture = read_needed_image(drive, frame)
    model = labeller.model
    write_image(draw_labels(picture, labeller.ids(picture), model.classes, model.ignore), path)
    terminal.print(f"drew {path}: {frame.image}")
