import dataclasses
import filecmp
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from semcal_cli import core
from semcal_cli.cli.synth import synth
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, check_rigid
from semcal_cli.observations.reading import load_observations
from semcal_cli.synthetic.frame_files import UNLABELED
from semcal_cli.synthetic.synthesis import LENSES, make_camera, make_renderer, mounting, synthesize

TINY = SynthConfig(num_frames=2, seed=5, channels=32, columns=400, width=320, height=180)
EXACT = 1e-9  # degrees or metres: round-off of a few rotations
TINY_FIGURES = {
    "image_labels/000000.png": (57600, 8.6779, 4.9439),
    "image_labels/000001.png": (57600, 7.1219, 5.1747),
    "images/000000.png": (172800, 141.8515, 55.2659),
    "images/000001.png": (172800, 124.0462, 45.2377),
    "point_labels/000000.label": (11870, 5548310.4488, 6404472.1800),
    "point_labels/000001.label": (11913, 5557615.8146, 7409001.4496),
    "points/000000.bin": (47480, 0.0797, 9.4961),
    "points/000001.bin": (47652, -0.1388, 10.8893),
}
"""Of the files of `TINY`: number of values, their mean and their standard deviation. Their bytes depend on the
machine's sines and cosines, whose last digits differ between processors."""
ROUND_OFF = 0.002
"""Share of a standard deviation by which round-off on another processor may move a mean."""
BORDER_PIXELS_AGREE = 0.97  # points within half a pixel of a border round to either side
STANDARD_ERRORS = 4.0  # one test in 16,000 would fail by chance, if seeds were not fixed


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synth") / "tiny"
    synthesize(TINY, folder)
    return folder


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def ids(drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """All class ids of the points, and all of the pixels."""
    points = [np.fromfile(drive.resolve(f.point_labels), "<u4") & 0xFFFF for f in drive.frames]
    images = [cv2.imread(str(drive.resolve(f.image_labels)), cv2.IMREAD_UNCHANGED) for f in drive.frames]
    return np.concatenate(points), np.concatenate(images)


def reference(drive: Drive) -> Pose:
    return np.array(drive.T_camera_lidar)


def test_same_seed_same_bytes_other_seed_other_bytes(tiny: Path, tmp_path: Path) -> None:
    synthesize(TINY, tmp_path / "again")
    synthesize(dataclasses.replace(TINY, seed=6), tmp_path / "other")
    names = files(tiny)
    assert len(names) == 1 + 4 * TINY.num_frames
    assert filecmp.cmpfiles(tiny, tmp_path / "again", names, shallow=False) == (names, [], [])
    assert filecmp.cmpfiles(tiny, tmp_path / "other", names, shallow=False) == ([], names, [])


@pytest.mark.parametrize("name", TINY_FIGURES)
def test_old_drives_stay_as_they_are(tiny: Path, name: str) -> None:
    path = tiny / name
    if path.suffix == ".png":
        values = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), np.float64)
    else:
        values = np.fromfile(path, "<f4" if path.suffix == ".bin" else "<u4").astype(np.float64)
    count, mean, spread = TINY_FIGURES[name]
    assert values.size == pytest.approx(count, rel=ROUND_OFF)
    assert values.mean() == pytest.approx(mean, abs=ROUND_OFF * spread)
    assert values.std() == pytest.approx(spread, rel=ROUND_OFF)


def test_drive_reads_back(tiny: Path) -> None:
    drive = read_drive(tiny)
    check_rigid(reference(drive))
    np.testing.assert_allclose(reference(drive), mounting(TINY), atol=EXACT)
    assert drive.camera == make_camera(TINY)
    assert drive.lidar is not None
    assert (drive.lidar.channels, drive.lidar.columns) == (TINY.channels, TINY.columns)
    observations = load_observations(drive)
    assert observations.num_frames == TINY.num_frames
    names = {name for _, name in core.synthetic_classes()}
    assert set(observations.point_class_names) | set(observations.image_class_names) <= names


def test_rosette_is_no_grid(tmp_path: Path) -> None:
    synthesize(dataclasses.replace(TINY, num_frames=1, pattern="rosette"), tmp_path)
    assert read_drive(tmp_path).lidar is None


def test_images_are_in_color_order(tiny: Path) -> None:
    renderer = make_renderer(TINY, mounting(TINY))
    image_rgb = renderer.frame(TINY.seed, 1).image_rgb
    written_bgr = cv2.imread(str(tiny / "images/000001.png"))
    np.testing.assert_array_equal(written_bgr[..., ::-1], image_rgb)


@pytest.mark.parametrize("azimuth", [-180.0, -100.0, 0.0, 37.5, 180.0])
def test_mounting_is_as_asked(azimuth: float) -> None:
    config = SynthConfig(
        camera_azimuth_deg=azimuth, camera_pitch_deg=-5.0, camera_roll_deg=3.0, baseline_m=0.7
    )
    T = mounting(config)
    forward, right = T[2, :3], T[0, :3]  # the camera's axes in the LiDAR frame
    turn = np.degrees(np.arctan2(forward[1], forward[0])) - azimuth
    assert (turn + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=EXACT)
    assert np.degrees(np.arcsin(forward[2])) == pytest.approx(-5.0, abs=EXACT)
    level_right = np.cross(forward, [0.0, 0.0, 1.0])
    lean = np.arccos(right @ level_right / np.linalg.norm(level_right))
    assert np.degrees(lean) == pytest.approx(3.0, abs=1e-6)  # an arc cosine near 1
    assert right[2] < 0.0
    assert np.linalg.norm(camera_center(T)) == pytest.approx(0.7, abs=EXACT)


def test_mounting_at_random_keeps_its_bounds() -> None:
    poses = [mounting(SynthConfig(seed=seed, max_baseline_m=0.5)) for seed in range(200)]
    distances = [np.linalg.norm(camera_center(T)) for T in poses]
    assert min(distances) >= 0.1
    assert max(distances) <= 0.5
    azimuths = [np.degrees(np.arctan2(T[2, 1], T[2, 0])) for T in poses]
    assert all(np.histogram(azimuths, bins=4, range=(-180.0, 180.0))[0] > 25)


@pytest.mark.parametrize("lens", ["standard", "narrow", "wide"])
@pytest.mark.parametrize("hfov_deg", [None, 60.0, 150.0])
def test_lens_reaches_every_pixel_and_spans_its_angle(lens: str, hfov_deg: float | None) -> None:
    camera = make_camera(SynthConfig(lens=lens, hfov_deg=hfov_deg))
    border = [(u, v) for u in range(0, 1280, 13) for v in (0, 360, 719)]
    rays = core_camera(camera).unproject(np.array(border, dtype=float))
    assert np.isfinite(rays).all()
    left, right = core_camera(camera).unproject(np.array([[-0.5, 359.5], [1279.5, 359.5]]))
    span = np.degrees(np.arccos(left @ right))
    assert span == pytest.approx(hfov_deg or LENSES[lens][2], abs=0.2)  # prisms bend the middle row a little


@pytest.mark.parametrize("lens", ["fisheye", "omnidirectional", "equirectangular"])
@pytest.mark.parametrize("hfov_deg", [None, 120.0])
def test_a_wide_lens_spans_its_angle(lens: str, hfov_deg: float | None) -> None:
    camera = core_camera(make_camera(SynthConfig(lens=lens, hfov_deg=hfov_deg)))
    middle, left, right = camera.unproject(np.array([[639.5, 359.5], [0.0, 359.5], [1279.0, 359.5]]))
    span = np.degrees(np.arccos(left @ middle) + np.arccos(middle @ right))
    assert span == pytest.approx(hfov_deg or LENSES[lens][2], abs=0.4)  # less half a pixel on either side


def test_a_lens_that_does_not_reach_is_refused() -> None:
    with pytest.raises(InputError, match="--hfov-deg: found 185, which the standard lens does not reach"):
        make_camera(SynthConfig(hfov_deg=185.0))


def test_visible_points_land_on_pixels_of_their_own_label() -> None:
    agree = total = 0
    for seed, lens in enumerate(LENSES):
        # Pixels about as fine as those of the other lenses.
        width, height = (2048, 1024) if LENSES[lens][2] > 180.0 else (640, 360)
        config = dataclasses.replace(
            TINY, seed=seed, lens=lens, width=width, height=height, range_noise_m=0.0
        )
        T = mounting(config)
        frame = make_renderer(config, T).frame(seed, 0)
        camera = core_camera(make_camera(config))
        pixels = core.project_points(camera, frame.points[:, :3].copy(), T).pixels
        is_visible = frame.point_visibility == 2
        u, v = np.rint(pixels[is_visible]).astype(int).T
        agree += np.count_nonzero(frame.image_labels[v, u] == frame.point_labels[is_visible] & 0xFFFF)
        total += len(u)
    assert total > 3000
    assert agree / total > BORDER_PIXELS_AGREE


def test_label_noise_is_what_was_asked(tiny: Path, tmp_path: Path) -> None:
    share = 0.3
    synthesize(dataclasses.replace(TINY, label_noise=share), tmp_path)
    for true, noisy in zip(ids(read_drive(tiny)), ids(read_drive(tmp_path)), strict=True):
        labelled = true != UNLABELED
        found = np.mean(true[labelled] != noisy[labelled])
        standard_error = np.sqrt(share * (1.0 - share) / np.count_nonzero(labelled))
        assert abs(found - share) < STANDARD_ERRORS * standard_error
        assert set(np.unique(noisy)) <= {UNLABELED, *(id_ for id_, _ in core.synthetic_classes())}


def test_disjoint_ontologies_share_no_id_and_merge_nothing(tiny: Path, tmp_path: Path) -> None:
    synthesize(dataclasses.replace(TINY, ontology="disjoint"), tmp_path)
    drive = read_drive(tmp_path)
    assert drive.classes is None
    points, image = ids(drive)
    assert not set(np.unique(points)) & set(np.unique(image))
    _, true = ids(read_drive(tiny))
    pairs = np.unique(np.stack([true.ravel(), image.ravel()]), axis=1)
    assert len(set(pairs[0])) == len(set(pairs[1])) == pairs.shape[1]
    assert sorted(pairs[1]) != pairs[1].tolist()  # no shift of the ids


def test_folder_that_is_not_empty_is_refused(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("text")
    with pytest.raises(InputError) as error:
        synthesize(TINY, tmp_path)
    complaint = "the folder is not empty; name another folder, or write into it with --force"
    assert str(error.value) == f"{tmp_path}: {complaint}"
    assert files(tmp_path) == ["precious"]
    synthesize(dataclasses.replace(TINY, num_frames=1), tmp_path, force=True)
    assert (tmp_path / "precious").read_text() == "text"
    assert len(read_drive(tmp_path).frames) == 1


def test_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("text")
    with pytest.raises(InputError, match=r"a/points: cannot be created: not a directory"):
        synthesize(TINY, tmp_path / "a")


def test_command(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "drive"
    options = "--frames 2 --seed 5 --channels 32 --columns 400 --width 320 --height 180"
    result = CliRunner().invoke(synth, [str(out), *options.split()])
    assert result.exit_code == 0, result.output
    assert result.stdout == ""
    points, image = ids(read_drive(out))
    num_classes = len(set(np.unique(points)) | set(np.unique(image)) - {UNLABELED})
    where, what = result.stderr.splitlines()
    assert where == f"wrote {out}"
    assert what.startswith(f"2 frames, {len(points):,} points, {num_classes} classes in ")
    names = files(tiny)
    assert filecmp.cmpfiles(tiny, out, names, shallow=False) == (names, [], [])


def test_drives_of_one_rig(tmp_path: Path) -> None:
    """Other streets, the same mounting; each is the drive that its own seed makes with the rig's."""
    small = ("--frames", "1", "--width", "64", "--height", "48", "--columns", "50", "-q")
    out = tmp_path / "drives"
    assert CliRunner().invoke(synth, [str(out), "--drives", "3", "--seed", "5", *small]).exit_code == 0
    drives = sorted(out.iterdir())
    assert [drive.name for drive in drives] == ["000000", "000001", "000002"]
    poses = [read_transform(drive) for drive in drives]
    assert poses[0].tolist() == poses[1].tolist() == poses[2].tolist()
    clouds = [(drive / "points/000000.bin").read_bytes() for drive in drives]
    assert len(set(clouds)) == 3
    alone = tmp_path / "alone"
    CliRunner().invoke(synth, [str(alone), "--seed", "7", "--rig-seed", "5", *small])
    assert (alone / "drive.yaml").read_bytes() == (drives[2] / "drive.yaml").read_bytes()
    assert (alone / "points/000000.bin").read_bytes() == clouds[2]
