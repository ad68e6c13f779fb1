"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.convert import FormatName, make_asked, open_options
from semcal_cli.cli.options import PATH, drive_argument, given_parameters, result_options
from semcal_cli.cli.refinement import make_refinement, refinement_options
from semcal_cli.cli.search import make_search, search_options

if TYPE_CHECKING:
    from semcal_cli.cli.session import Session
    from semcal_cli.result.calibration import Calibration

WITH_SOIC = (
    *("drive", "method", "init", "init_rpy_xyz", "to", "to_direction", "to_frame", "to_camera", "to_lidar"),
    *("max_baseline_m", "page", "pictures", "output", "threads", "quiet", "log", "max_frames"),
)
"""Parameters of `calibrate` that say nothing of mutual information."""


@click.command()
@drive_argument
@click.option(
    "--method",
    type=click.Choice(["mi", "soic"]),
    default="mi",
    show_default=True,
    help="Mutual information, or SOIC, a rival to compare with: it needs the same class names on both sides, and does "
    "not say how sure it is.",
)
@search_options
@refinement_options
@click.option(
    "--repeat",
    type=click.IntRange(2),
    metavar="N",
    help="Calibrate with N seeds, and report how far apart they lead beside the stated uncertainty.",
)
@click.option(
    "--to",
    type=FormatName(),
    metavar="FORMAT",
    help="Write only the transform, in a format that `convert --formats` lists.",
)
@open_options("to-", "what is written with --to")
@click.option("--report", "page", type=PATH, metavar="FILE", help="Write a page about it, too: .html.")
@click.option(
    "--overlay",
    "pictures",
    type=PATH,
    metavar="DIR",
    help="Write pictures of points on images there, too, before and after, of at most 20 frames.",
)
@result_options
def calibrate(
    drive: Path,
    method: str,
    repeat: int | None,
    to: str | None,
    page: Path | None,
    pictures: Path | None,
    **options: Any,
) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    Needs no start guess: all mounting directions are searched, then the best pose is refined. Exit code 3 means that
    an answer was written but is not trusted.

    DRIVE may be a rig.yaml, which names the drives of several cameras of one LiDAR: all are calibrated, and -o is a
    folder for the result of each and for rig_calibration.yaml, with each camera beside each other.
    """
    from semcal_cli.cli.session import Session
    from semcal_cli.rig.document import find_rig

    if method == "soic":
        _check_soic()
    config, given = make_search(options)
    asked = make_asked(options, "to_")
    if to is None and any(vars(asked).values()):
        raise click.UsageError(
            "--to-direction, --to-frame, --to-camera, --to-lidar: are of --to: give it, too"
        )
    refinement = make_refinement(options, config.alignment.max_baseline_m, given)

    def run(session: Session) -> Calibration:
        if method == "soic":
            return session.run.calibrate_by_soic(session.folder, given, config.alignment.max_baseline_m)
        return session.run.calibrate(session.folder, config, given, refinement, num_seeds=repeat or 1)

    if (rig := find_rig(drive)) is not None:
        from semcal_cli.cli.rig import calibrate_rig

        sys.exit(calibrate_rig(rig, run, options))
    options |= {"to": None if to is None else (to, asked), "page": page, "pictures": pictures}
    with Session(drive, given=given, **options) as session:
        calibration = run(session)
        code = session.finish(calibration)
    session.illustrate(calibration, page, pictures)
    sys.exit(code)


def _check_soic() -> None:
    """Check that no option is given that says how mutual information is searched or climbed.

    Raises:
        click.UsageError: one is.
    """
    context = click.get_current_context()
    for parameter in given_parameters(context):
        by_labels = parameter.name == "cues" and context.params["cues"] == ("labels",)
        if parameter.name not in WITH_SOIC and not by_labels:
            raise click.UsageError(f"{parameter.opts[0]}: is of --method mi")
