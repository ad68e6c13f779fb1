"""`semcal doctor`: what it says of extras and of the network."""

import json
import re
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import pytest
from commands import invoke, unwrapped
from documentation import ROOT
from huggingface_hub import constants

from semcal_cli.cli import doctor
from semcal_cli.cli.doctor import EXTRAS
from semcal_cli.errors import describe_extra

NOWHERE = "http://127.0.0.1:9"


@pytest.fixture(autouse=True)
def _without_hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HF_ENDPOINT", NOWHERE)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))


def test_extras_and_their_packages_are_those_that_pip_installs() -> None:
    section = (ROOT / "pyproject.toml").read_text().partition("[project.optional-dependencies]\n")[2]
    extras = dict(re.findall(r"^(\w+) = \[(.*)\]$", section.partition("\n\n")[0], re.MULTILINE))
    # Not PyTorch, which is ten times as large as all else.
    assert extras.pop("all") == f'"semcal[{",".join(sorted(EXTRAS.keys() - {"mine"}))}]"'
    assert set(EXTRAS) == set(extras)
    for name, extra in EXTRAS.items():
        assert all(
            f'"{package}' in extras[name] or f"[{package}]" in extras[name]
            for package in extra.packages.values()
        )


def test_a_missing_extra_says_what_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "is_installed", lambda module: module not in ("kiss_icp", "huggingface_hub"))
    told = unwrapped(invoke("doctor").stdout, 17)
    assert "extra odometry   missing: kiss-icp. Needed for the motion of the LiDAR" in told
    assert f"Install {describe_extra('odometry')}" in told
    assert "cache            none without huggingface_hub" in told
    assert "extra bag        installed: rosbags " in told


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        (None, "semcal[bag]"),
        ({"url": "file:///home/me/semcal", "dir_info": {}}, "semcal[bag] @ file:///home/me/semcal"),
        (
            {"url": "https://github.com/o/semcal", "vcs_info": {"vcs": "git", "commit_id": "1"}},
            "semcal[bag] @ git+https://github.com/o/semcal@1",
        ),
    ],
)
def test_an_extra_comes_from_where_semcal_came_from(
    record: object, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = None if record is None else json.dumps(record)
    monkeypatch.setattr(
        "importlib.metadata.distribution", lambda name: SimpleNamespace(read_text=lambda file: text)
    )
    assert describe_extra("bag") == f"the extra 'bag': pip install '{expected}'"


def test_a_missing_distribution_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV may be there as opencv-python, without the distribution that semcal names."""

    def version(name: str) -> str:
        if name == "opencv-python-headless":
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(doctor, "version", version)
    told = unwrapped(invoke("doctor").stdout, 17)
    assert "opencv-python-headless of unknown version, pydantic 1.0" in told


def test_cache_and_network_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hub/models--owner--name").mkdir(parents=True)
    told = unwrapped(invoke("doctor").stdout, 17)
    assert f"cache            {tmp_path / 'hub'}: owner/name" in told
    assert f"network          {NOWHERE} is not reachable" in told
    assert "everything else works without a network" in told
    assert f"python           {sys.version.split()[0]} in " in told
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    assert "not used, because HF_HUB_OFFLINE is set" in unwrapped(invoke("doctor").stdout, 17)


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        ("http://127.0.0.1:x", "http://127.0.0.1:x is not reachable (nonnumeric port"),
        ("http://me:secret@127.0.0.1:9", "http://127.0.0.1:9 is not reachable (<urlopen error [Errno"),
        ("http://me:secret@127.0.0.1", "http://127.0.0.1 "),
        ("http://me:s/secret@127.0.0.1:9", "http://127.0.0.1:9 is not reachable"),
        ("me:secret@hub", "hub: found in HF_ENDPOINT, expected an address that begins with https://"),
        (
            "file:///etc/passwd",
            "file:///etc/passwd: found in HF_ENDPOINT, expected an address that begins with https://",
        ),
    ],
)
def test_an_address_of_another_kind_is_told_without_its_password(
    endpoint: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_ENDPOINT", endpoint)
    told = unwrapped(invoke("doctor").stdout, 17)
    assert said in told
    assert "secret" not in told
