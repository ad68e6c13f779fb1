"""`semcal refine`: the second half of the pipeline."""

from __future__ import annotations

from pathlib import Path

import click

from semcal_cli.cli.options import PATH, device_option, drive_argument, result_options


@click.command()
@drive_argument
@click.option(
    "--init",
    type=PATH,
    metavar="FILE",
    required=True,
    help="The transform to start at: a calibration, a drive's reference, a RELLIS-3D transforms.yaml.",
)
@device_option
@result_options
def refine(
    drive: Path,
    init: Path,
    device: str,
    output: Path | None,
    log: Path | None,
    seed: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Refine a transform that is known to several degrees on DRIVE."""
    from semcal_cli.cli.calibrate import calibrate

    click.get_current_context().invoke(
        calibrate,
        drive=drive,
        init=init,
        zoom="exact",
        device=device,
        output=output,
        log=log,
        seed=seed,
        threads=threads,
        quiet=quiet,
    )
