"""`semcal doctor`: what is installed here, what is missing, and what does not work without it."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import click

from semcal_cli.cli.settings_command import ExampleCommand
from semcal_cli.errors import counted, describe_extra, is_installed, reason

HUB = "https://huggingface.co"
TIMEOUT_S = 3.0
"""Time in which the hub has to answer."""


class Extra(NamedTuple):
    """An extra of semcal."""

    packages: dict[str, str]
    """Its distributions that are used directly, by their import names."""
    use: str
    """What needs it."""


EXTRAS = {
    "bag": Extra(
        {"rosbags": "rosbags", "mcap": "mcap", "av": "av", "lz4": "lz4", "zstandard": "zstandard"},
        "recordings of ROS 1, ROS 2 and Foxglove",
    ),
    "odometry": Extra(
        {"kiss_icp": "kiss-icp"},
        "the motion of the LiDAR from its sweeps, which deskews them and checks the clock",
    ),
    "registration": Extra(
        {"small_gicp": "small_gicp"}, "the registration of the sweeps of several LiDARs of a rig"
    ),
    "label": Extra(
        {"onnxruntime": "onnxruntime", "huggingface_hub": "huggingface_hub"}, "image labels by networks"
    ),
    "mine": Extra({"torch": "torch"}, "the paper's estimator, MINE, and feature vectors"),
    "las": Extra({"laspy": "laspy", "lazrs": "lazrs"}, "point clouds in .las and .laz"),
    "e57": Extra({"pye57": "pye57"}, "point clouds in .e57"),
    "velodyne": Extra({"velodyne_decoder": "velodyne-decoder"}, "recordings with packets of a Velodyne"),
    "view": Extra({"rerun": "rerun-sdk"}, "`semcal export rerun`"),
    "dask": Extra({"distributed": "distributed"}, "`semcal batch --dask`"),
}
"""The extras for users, by the names that `pip install` takes."""
BESIDE = ("numpy", "scipy", "opencv-python-headless", "pydantic", "click")
"""Distributions whose versions matter most where results differ."""


@click.command(cls=ExampleCommand)
def doctor() -> None:
    """Show versions, extras, threads and caches, and what does not work for want of an extra or of the network.

    Nothing is installed or changed, and nothing is sent: the only request asks whether huggingface.co answers.
    """
    from semcal_cli.cli.tables import wrapped

    for label, text in _rows():
        click.echo("\n".join(wrapped(label, text)))


def _rows() -> Iterator[tuple[str, str]]:
    from semcal_cli import core
    from semcal_cli.threads import num_cores

    where = Path(str(core.__file__)).parent
    yield "semcal", f"{_version('semcal')} in {where}"
    yield "python", f"{platform.python_version()} in {sys.prefix}, {platform.system()} {platform.machine()}"
    yield "libraries", ", ".join(f"{name} {_version(name)}" for name in BESIDE)
    yield "threads", f"{counted(num_cores(), 'core')}, all of which are used unless --threads says otherwise"
    for name, extra in EXTRAS.items():
        yield f"extra {name}", _state(name, extra)
    yield "cache", _cache()
    yield "network", _network()


def _state(name: str, extra: Extra) -> str:
    missing = [package for module, package in extra.packages.items() if not is_installed(module)]
    if missing:
        return f"missing: {', '.join(missing)}. Needed for {extra.use}. Install {describe_extra(name)}"
    return f"installed: {', '.join(f'{package} {_version(package)}' for package in extra.packages.values())}"


def _version(package: str) -> str:
    with suppress(PackageNotFoundError):
        return version(package)
    return "of unknown version"


def _cache() -> str:
    """Describe the networks in the cache of the hub."""
    if not is_installed("huggingface_hub"):
        return "none without huggingface_hub, which keeps the networks that are fetched"
    from huggingface_hub import constants

    folder = Path(constants.HF_HUB_CACHE)
    networks = sorted(
        path.name.removeprefix("models--").replace("--", "/") for path in folder.glob("models--*")
    )
    return f"{folder}: {', '.join(networks)}" if networks else f"no networks in {folder}"


def _network() -> str:
    """Describe whether the hub answers."""
    from http.client import HTTPException
    from urllib.error import HTTPError
    from urllib.request import Request, urlopen

    from semcal_cli.labelling.hub_answers import within, without_passwords

    endpoint = os.environ.get("HF_ENDPOINT") or HUB
    without = (
        "Networks for image labels must be files or in the cache; everything else works without a network"
    )
    if os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "TRUE", "YES", "ON"):
        return f"not used, because HF_HUB_OFFLINE is set. {without}"
    # A name and a password are not for those who read the report; the hub answers without them, too.
    shown = without_passwords(endpoint) if "://" in endpoint else endpoint.rpartition("@")[2]
    if not endpoint.startswith(("http://", "https://")):
        return f"{shown}: found in HF_ENDPOINT, expected an address that begins with https://. {without}"

    def ask() -> None:
        with suppress(HTTPError), urlopen(Request(shown, method="HEAD"), timeout=TIMEOUT_S):
            pass

    try:
        within(TIMEOUT_S, ask)  # The resolution of a name has no time limit of its own.
    except (OSError, ValueError, HTTPException) as error:
        return f"{shown} is not reachable ({reason(error)}). {without}"
    return f"{shown} answers"
