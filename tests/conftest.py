import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault(
    "OMP_NUM_THREADS", "1"
)  # torch's threads wait for one another where several workers run

import headless
import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from hypothesis import settings, strategies as st
from laboratory import spoiling
from laboratory.raw_drive import RawDrive, read_raw_drive, write_raw_drive
from refined import spoiled, with_camera
from scipy.spatial.transform import Rotation
from selenium import webdriver

from semcal_cli.cli import main, semcal
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.many.rig.sweep_registration import MIN_PAIRS
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations, read_clouds
from semcal_cli.report.view.session import Session
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration, write_calibration
from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig

settings.register_profile("semcal", deadline=None)  # a busy machine is no failure
settings.load_profile("semcal")

semcal.load_all()  # tests look through the commands, which are else imported when they are called
TEST_DATA = Path(os.environ.get("SEMCAL_TEST_DATA", Path(__file__).parents[1] / "../shared/data"))

DRIVE = """
semcal_drive: 1
camera:
  model: plumb_bob
  width: 1280
  height: 720
  K: [[640, 0, 639.5], [0, 640, 359.5], [0, 0, 1]]
frames:
- points: points/000000.bin
"""


@pytest.fixture
def document() -> dict[str, Any]:
    """The smallest drive, to be broken."""
    return yaml.safe_load(DRIVE)


def real(name: str) -> Path:
    """A file or folder of real frames; a test is left out where they are not there."""
    path = (TEST_DATA / name).resolve()
    if not path.exists():
        pytest.skip(f"no real frames: {path} does not exist; set SEMCAL_TEST_DATA")
    return path


@pytest.fixture
def rellis3d() -> Path:
    return real("rellis3d_000104")


def make_pose(rotation_vector: tuple[float, ...], translation: tuple[float, ...]) -> Pose:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = translation
    return T


def with_twists(observations: Observations, twists_per_s: Sequence[Sequence[float]]) -> Observations:
    """The same frames, in which the LiDAR moves as said: a twist (6,) a second each."""
    pairs = zip(observations.frame_observations, twists_per_s, strict=True)
    moving = tuple(replace(frame, twist_per_s=twist) for frame, twist in pairs)
    return replace(observations, frame_observations=moving)


@contextmanager
def edited(drive: Path, out: Path | None = None) -> Iterator[dict[str, Any]]:
    """The document of a drive, which is written as it is left, there or into another folder."""
    document = read_document(drive / DRIVE_FILE)
    yield document
    write_text(document_text(document, "yaml"), (out or drive) / DRIVE_FILE)


def without(drive: Path, *keys: str) -> Path:
    """Take files out of all frames of a drive, and the classes that nothing of it has any more."""
    with edited(drive) as document:
        for frame in document["frames"]:
            for key in keys:
                frame.pop(key, None)
        if "point_labels" in keys:
            document.get("classes", {}).pop("points", None)
        if "image_labels" in keys:
            document.pop("classes", None)
    return drive


def triples(limit: float) -> st.SearchStrategy[tuple[float, float, float]]:
    number = st.floats(-limit, limit)
    return st.tuples(number, number, number)


poses = st.builds(make_pose, triples(np.pi), triples(100.0))

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
keys = st.sampled_from(
    [
        "semcal_drive",
        "semcal_calibration",
        "camera",
        "T_camera_lidar",
        "os1_cloud_node-pylon_camera_node",
        "q",
    ]
)
documents = st.recursive(
    scalars, lambda x: st.lists(x, max_size=4) | st.dictionaries(keys | scalars, x, max_size=5), max_leaves=20
)
"""Anything that YAML can hold, with a bias to our own keys."""


STREET = SynthConfig(num_frames=4, seed=11, width=640, height=360, columns=400)
FINE_STREET = replace(STREET, columns=800)
"""The same with twice the points, for what few of them do not tell."""
SMALL_DRIVE = SynthConfig(num_frames=6, seed=93001, width=320, height=180, channels=32, columns=400)


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small synthetic drive with a known answer; tests do not write to it."""
    folder = tmp_path_factory.mktemp("street") / "drive"
    synthesize(STREET, folder)
    return folder


@pytest.fixture(scope="session")
def fine_street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive of `street` with twice the points, and the same truth; tests do not write to it."""
    folder = tmp_path_factory.mktemp("fine_street") / "drive"
    synthesize(FINE_STREET, folder)
    return folder


@pytest.fixture(scope="session")
def synthetic(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """A small drive with labels and images; tests do not write to it."""
    folder = tmp_path_factory.mktemp("synthetic")
    synthesize(SMALL_DRIVE, folder)
    return read_drive(folder)


@pytest.fixture
def drive(street: Path, tmp_path: Path) -> Path:
    """A copy of a drive, to be broken."""
    return Path(shutil.copytree(street, tmp_path / "drive"))


@pytest.fixture
def plain(drive: Path) -> Path:
    """A drive of three frames without image labels."""
    with edited(drive) as document:
        for frame in document["frames"]:
            del frame["image_labels"]
        document["classes"].pop("image")
    shutil.rmtree(drive / "image_labels")
    return drive


@pytest.fixture(scope="session")
def street_observations(street: Path) -> Observations:
    return load_observations(read_drive(street))


@pytest.fixture(scope="session")
def street_truth(street: Path) -> Pose:
    return read_transform(street)


@pytest.fixture(scope="session")
def raw(street: Path) -> RawDrive:
    """The content of the files of the small drive, to be spoiled."""
    return read_raw_drive(read_drive(street), read_transform(street))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture(scope="session")
def long_street(tmp_path_factory: pytest.TempPathFactory) -> RawDrive:
    """A drive of eight frames, to be spoiled."""
    folder = tmp_path_factory.mktemp("long_street") / "drive"
    synthesize(replace(FINE_STREET, num_frames=8), folder)
    return read_raw_drive(read_drive(folder), read_transform(folder))


@pytest.fixture(scope="session")
def knocked(long_street: RawDrive) -> RawDrive:
    """The same drive, whose camera is turned by one degree from the sixth frame on."""
    return spoiling.knocked(long_street, np.random.default_rng(3), angle_deg=1.0, share=0.4)


@pytest.fixture(scope="session")
def knocked_drive(knocked: RawDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the drive with the knocked camera; tests do not write to them."""
    return write_raw_drive(knocked, tmp_path_factory.mktemp("knocked")).parent


Cli = Callable[..., tuple[int, str, str]]


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the command in this process: exit code, standard output, standard error."""
    argv, sys.argv = sys.argv, ["semcal", *map(str, arguments)]
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = int(stop.code or 0)
    finally:
        sys.argv = argv
    return code, *capfd.readouterr()


@pytest.fixture
def cli(capfd: pytest.CaptureFixture[str]) -> Cli:
    """The command: its exit code, standard output and standard error."""
    return partial(run, capfd)


@pytest.fixture(scope="session")
def made(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a calibration, its page and its images, all of one run; tests do not write to it."""
    folder = tmp_path_factory.mktemp("made")
    options = ["--report", folder / "r.html", "--overlay", folder / "overlays"]
    result = invoke("calibrate", street, "-o", folder / "c.yaml", *options)
    assert result.exit_code in (0, 3), result.output
    return folder


@pytest.fixture
def refined(made: Path) -> CalibrationDocument:
    """What a calibration says that has found a camera on a drive with another one."""
    known = read_calibration(made / "c.yaml")
    right = known.input.camera
    return with_camera(known, spoiled(right), right)


@pytest.fixture
def refined_file(refined: CalibrationDocument, tmp_path: Path) -> Path:
    write_calibration(refined, tmp_path / "c.yaml")
    return tmp_path / "c.yaml"


@pytest.fixture
def rejected_file(refined: CalibrationDocument, tmp_path: Path) -> Path:
    """The same, whose camera was not kept."""
    write_calibration(
        with_camera(refined, refined.input.camera, refined.used_camera, is_kept=False),
        tmp_path / "rejected.yaml",
    )
    return tmp_path / "rejected.yaml"


SMALL = SynthConfig(
    num_frames=3, seed=5, channels=32, columns=500, width=480, height=270, camera_roll_deg=0.0
)
SMALL_LIDARS = replace(SMALL, num_frames=MIN_PAIRS)
NAMES = ("camera_0", "camera_1")
"""Cameras of the rig."""
LIDAR = "lidar_1"
"""The further LiDAR of a rig of two."""


@pytest.fixture(scope="session")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig of two cameras, which tests do not write to."""
    out = tmp_path_factory.mktemp("rigs") / "rig"
    synthesize_rig(SMALL, len(NAMES), out)
    return out / "rig.yaml"


@pytest.fixture(scope="session")
def rig_results(rig: Path) -> tuple[Result, Path]:
    """What `semcal calibrate` makes of the rig, with its page and its log beside the folder of the results."""
    beside = rig.parents[1]
    options = ["-o", beside / "results", "--log", beside / "log.json", "--report", beside / "rig.html"]
    return invoke("calibrate", rig, *options), beside / "results"


@pytest.fixture(scope="session")
def lidars(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig of two cameras and two LiDARs, whose sweeps are to be registered; tests do not write to it."""
    path = tmp_path_factory.mktemp("lidars") / "rig/rig.yaml"
    synthesize_rig(SMALL_LIDARS, 2, path.parent, num_lidars=2)
    document = yaml.safe_load(path.read_text())
    document["lidars"][LIDAR]["register"] = True
    path.write_text(path.read_text().splitlines()[0] + "\n" + yaml.safe_dump(document, sort_keys=False))
    return path


@pytest.fixture(scope="session")
def lidar_results(lidars: Path) -> tuple[Result, Path]:
    out = lidars.parents[1] / "results"
    return invoke("calibrate", lidars, "-o", out, "--report", out.with_suffix(".html")), out


@pytest.fixture(scope="session")
def sure(lidar_results: tuple[Result, Path]) -> CalibrationDocument:
    """A calibration, whatever it says, as if by many parts of the images."""
    calibration = read_calibration(lidar_results[1] / f"{NAMES[0]}.yaml")
    many = calibration.uncertainty.model_copy(update={"degrees_of_freedom": (1e4,) * 6})
    sound = {"status": "trusted", "reasons": (), "topics": (), "uncertainty": many}
    return calibration.model_copy(update=sound)


@pytest.fixture(scope="session")
def browser() -> Iterator[webdriver.Chrome]:
    """A browser, which CI has to have."""
    if headless.missing():
        (pytest.fail if "CI" in os.environ else pytest.skip)(headless.missing())
    with headless.chromium("--window-size=1280,900") as chrome:
        yield chrome


@pytest.fixture(scope="module")
def T_off(street_truth: Pose) -> Pose:
    """The truth, turned by 1.5 degrees."""
    return apply_twist(street_truth, np.array([0.0, 0.0, 0.0, 0.0, np.radians(1.5), 0.0]))


@pytest.fixture(scope="module")
def session(street: Path, T_off: Pose, tmp_path_factory: pytest.TempPathFactory) -> Session:
    """What `semcal view` shows, from `T_off` on."""
    config = CalibrationConfig()
    data = load(read_drive(street), config)
    output = tmp_path_factory.mktemp("view") / "init.yaml"
    return Session(data, read_clouds(data.drive), config, T_off, output)


@pytest.fixture(scope="module")
def by_edge(street: Path, street_truth: Pose) -> Session:
    """The same by edges, from the truth on."""
    config = CalibrationConfig(cues=("segments", "edges"))
    data = load(read_drive(street), config)
    return Session(data, read_clouds(data.drive), config, street_truth)
