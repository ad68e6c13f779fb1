"""Point clouds: real files, and the same little cloud in every format."""

import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from conftest import DRIVE, real
from e57_scans import content_of, paged, write_e57
from hypothesis import given, strategies as st
from plyfile import PlyData, PlyElement

from semcal_cli import core
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import read_image
from semcal_cli.files.point_clouds import read_point_clouds
from semcal_cli.observations.reading import read_observations


def read(points: Path, labels: Path | None = None) -> core.PointCloud:
    (cloud,) = read_point_clouds([(points, labels)])
    return cloud


@pytest.mark.parametrize(("frame", "count"), [("1", 101340), ("2", 98805), ("3", 85546)])
def test_compressed_pcd_of_a_road(frame: str, count: int) -> None:
    cloud = read(real(f"opencalib_road/{frame}/calib.pcd"))
    assert cloud.points.shape == (count, 3)
    assert cloud.intensity is not None
    assert cloud.ring is not None
    assert cloud.time is not None
    np.testing.assert_array_equal(np.unique(cloud.ring), np.arange(64))
    assert cloud.intensity.max() == 254
    # A sweep at 10 Hz, of the days on which it was recorded.
    assert 0.09 < np.ptp(cloud.time) < 0.11
    assert 1.6e9 < cloud.time.min() < 1.7e9
    # Rings are cones: a beam's elevation hardly varies, and differs from that of others.
    elevation = np.degrees(np.arctan2(cloud.points[:, 2], np.hypot(*cloud.points[:, :2].T)))
    spread = [np.ptp(np.percentile(elevation[cloud.ring == ring], [5, 95])) for ring in range(64)]
    assert np.median(spread) < 1.0 < np.ptp(elevation) / 10


def test_bin_and_ply_of_one_sweep_agree() -> None:
    points = read(real("rellis3d_000104/000104.bin"))
    mesh = read(real("rellis3d_000104/frame000104-1581624663_170.ply"))
    np.testing.assert_array_equal(points.points, mesh.points)
    assert points.num_no_returns == mesh.num_no_returns == 53364
    assert (points.ring, points.time) == (None, None)
    assert mesh.ring is not None
    assert mesh.time is not None
    np.testing.assert_array_equal(np.unique(mesh.ring), np.arange(64))
    assert 0.09 < mesh.time.max() < 0.1


def test_nuscenes_sweep() -> None:
    cloud = read(next(real("nuscenes_keyframe").glob("*.pcd.bin")))
    assert cloud.points.shape == (34688, 3)
    assert cloud.ring is not None
    np.testing.assert_array_equal(np.unique(cloud.ring), np.arange(32))


RECORD = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "label", "time"],
        "formats": ["<f4"] * 4 + ["<u2"] * 2 + ["<f8"],
    }
)


def little_cloud() -> np.ndarray:
    """Two of its entries are no returns."""
    rng = np.random.default_rng(0)
    cloud = np.zeros(40, RECORD)
    for axis in "xyz":
        cloud[axis] = (rng.integers(-4000, 4000, 40) + 0.5) / 64  # exact in steps of 1/128 m, as LAS stores
    cloud["intensity"] = rng.integers(0, 256, 40)
    cloud["ring"] = rng.integers(0, 64, 40)
    cloud["label"] = rng.integers(0, 32, 40)  # LAS 1.2 has five bits for it
    cloud["time"] = np.arange(40) / 1024
    cloud[3] = 0
    cloud[8] = 0
    return cloud


def columns(cloud: np.ndarray, *names: str) -> np.ndarray:
    return np.stack([cloud[name].astype(np.float32) for name in names], axis=1)


def pcd_header(cloud: np.ndarray, encoding: str, version: str = "0.7") -> bytes:
    kinds = [cloud.dtype[name].base.kind.upper().replace("V", "U") for name in cloud.dtype.names]
    sizes = [str(cloud.dtype[name].base.itemsize) for name in cloud.dtype.names]
    counts = [str(int(np.prod(cloud.dtype[name].shape))) for name in cloud.dtype.names]
    names = " ".join("_" if name.startswith("_") else name for name in cloud.dtype.names)
    lines = [
        f"# .PCD v{version} - Point Cloud Data file format",
        f"VERSION {version}",
        f"FIELDS {names}",
        f"SIZE {' '.join(sizes)}",
        f"TYPE {' '.join(kinds)}",
        f"COUNT {' '.join(counts)}",
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(cloud)}",
        f"DATA {encoding}",
    ]
    return ("\n".join(lines) + "\n").encode()


def text(cloud: np.ndarray) -> bytes:
    flat = [[value for field in row.tolist() for value in np.atleast_1d(field)] for row in cloud]
    return "".join(" ".join(map(str, row)) + "\n" for row in flat).encode()


def lzf(data: bytes) -> bytes:
    """LZF, with a repeat wherever eight bytes are those just before."""
    packed, index = b"", 0
    while index < len(data):
        if index >= 8 and data[index - 8 : index] == data[index : index + 8]:
            packed += bytes([6 << 5, 7])
            index += 8
        else:
            chunk = data[index : index + 8]
            packed += bytes([len(chunk) - 1]) + chunk
            index += len(chunk)
    return packed


def padded(cloud: np.ndarray) -> np.ndarray:
    """Other fields, padding and an odd order around those that are used."""
    dtype = [
        ("_a", "u1", (3,)),
        ("normal", "<f4", (3,)),
        *reversed(RECORD.descr),
        ("_b", "<u4"),
        ("rgb", "<f4"),
    ]
    wide = np.ones(len(cloud), dtype)
    for name in RECORD.names:
        wide[name] = cloud[name]
    return wide


def write_pcd(encoding: str) -> Callable[[np.ndarray, Path], Path]:
    def write(cloud: np.ndarray, path: Path) -> Path:
        wide = padded(cloud)
        data = {
            "ascii": text(wide),
            "binary": wide.tobytes(),
            "binary_compressed": b"".join(
                np.ascontiguousarray(wide[name]).tobytes() for name in wide.dtype.names
            ),
        }[encoding]
        if encoding == "binary_compressed":
            packed = lzf(data)
            assert len(packed) < len(data)
            data = struct.pack("<II", len(packed), len(data)) + packed
        path = path.with_suffix(".pcd")
        path.write_bytes(pcd_header(wide, encoding) + data)
        return path

    return write


def write_plyfile(in_text: bool, byte_order: str = "<") -> Callable[[np.ndarray, Path], Path]:
    def write(cloud: np.ndarray, path: Path) -> Path:
        faces = np.array([([0, 1, 2], 7), ([3, 4], 8)], [("vertex_indices", "O"), ("flag", "u1")])
        elements = [PlyElement.describe(faces, "face"), PlyElement.describe(cloud, "vertex")]
        PlyData(elements, text=in_text, byte_order="=" if in_text else byte_order).write(
            str(path.with_suffix(".ply"))
        )
        return path.with_suffix(".ply")

    return write


def write_bin(cloud: np.ndarray, path: Path) -> Path:
    path = path.with_suffix(".bin")
    columns(cloud, "x", "y", "z", "intensity").tofile(path)
    return path


def write_nuscenes(cloud: np.ndarray, path: Path) -> Path:
    path = path.with_suffix(".pcd.bin")
    columns(cloud, "x", "y", "z", "intensity", "ring").tofile(path)
    return path


def write_npy(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray, Path], Path]:
    def write(cloud: np.ndarray, path: Path) -> Path:
        np.save(path.with_suffix(".npy"), change(cloud))
        return path.with_suffix(".npy")

    return write


def write_npz(cloud: np.ndarray, path: Path) -> Path:
    path = path.with_suffix(".npz")
    others = {name: cloud[name] for name in ("intensity", "ring", "label", "time")}
    np.savez_compressed(path, points=columns(cloud, "x", "y", "z"), **others)
    return path


def write_las(suffix: str, version: str) -> Callable[[np.ndarray, Path], Path]:
    def write(cloud: np.ndarray, path: Path) -> Path:
        las = laspy.create(point_format={"1.2": 1, "1.4": 6}[version], file_version=version)
        las.header.scales = [1 / 128] * 3
        las.x, las.y, las.z = (cloud[axis] for axis in "xyz")
        las.intensity, las.gps_time = cloud["intensity"], cloud["time"]
        las.classification = cloud["label"]
        las.write(path.with_suffix(suffix))
        return path.with_suffix(suffix)

    return write


XYZI = ("x", "y", "z", "intensity")
ALL = {"intensity", "ring", "labels", "time"}
WRITERS: dict[str, tuple[Callable[[np.ndarray, Path], Path], set[str]]] = {
    "KITTI .bin": (write_bin, {"intensity"}),
    "nuScenes .pcd.bin": (write_nuscenes, {"intensity", "ring"}),
    "PCD ascii": (write_pcd("ascii"), ALL),
    "PCD binary": (write_pcd("binary"), ALL),
    "PCD binary_compressed": (write_pcd("binary_compressed"), ALL),
    "PLY ascii": (write_plyfile(in_text=True), ALL),
    "PLY binary": (write_plyfile(in_text=False), ALL),
    "PLY big-endian": (write_plyfile(in_text=False, byte_order=">"), ALL),
    "NPY records": (write_npy(padded), ALL),
    "NPY N x 4": (write_npy(lambda cloud: columns(cloud, *XYZI).astype(np.float64)), {"intensity"}),
    "NPZ": (write_npz, ALL),
    "LAS 1.2": (write_las(".las", "1.2"), {"intensity", "labels", "time"}),
    "LAZ 1.4": (write_las(".laz", "1.4"), {"intensity", "labels", "time"}),
    "E57": (write_e57, {"intensity"}),
    "NPY N x 3, Fortran": (write_npy(lambda cloud: np.asfortranarray(columns(cloud, *"xyz"))), set()),
}


@pytest.mark.parametrize(("write", "kept"), WRITERS.values(), ids=WRITERS.keys())
def test_every_reader_reads_the_same_cloud(
    tmp_path: Path, write: Callable[[np.ndarray, Path], Path], kept: set[str]
) -> None:
    cloud = little_cloud()
    expected = np.delete(cloud, [3, 8])
    path = write(cloud, tmp_path / "a")
    found = read(path)
    assert found.points.dtype == np.float32
    np.testing.assert_array_equal(found.points, columns(expected, *"xyz"))
    assert found.num_no_returns == 2
    assert len(read_point_clouds([(path, None)], len(cloud))[0].points) == len(expected)
    with pytest.raises(InputError, match="found 40 points, needed at most 39: see --max-points"):
        read_point_clouds([(path, None)], len(cloud) - 1)
    names = {"intensity": "intensity", "ring": "ring", "labels": "label", "time": "time"}
    for attribute, name in names.items():
        values = getattr(found, attribute)
        assert (values is not None) == (attribute in kept)
        if values is not None:
            np.testing.assert_array_equal(values, expected[name])
    cloud["label"].astype(np.uint8).tofile(tmp_path / "lidarseg.bin")
    (cloud["label"].astype("<u4") + (5 << 16)).tofile(tmp_path / "a.label")
    np.save(tmp_path / "ids.npy", cloud["label"].astype(">i8"))
    for labels in ("lidarseg.bin", "a.label", "ids.npy"):
        np.testing.assert_array_equal(read(path, tmp_path / labels).labels, expected["label"])
    np.save(tmp_path / "ids.npy", np.zeros(39, np.uint8))
    with pytest.raises(InputError) as complaint:
        read(path, tmp_path / "ids.npy")
    assert str(complaint.value) == f"{tmp_path}/ids.npy: 39 labels for the 40 points of {path}"


@pytest.mark.parametrize("name", ["PCD binary_compressed", "LAS 1.2", "LAZ 1.4", "E57"])
def test_damaged_files_are_a_cloud_or_one_line(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    """The core's own readers are fuzzed in Rust."""
    path = WRITERS[name][0](little_cloud(), tmp_path_factory.mktemp("damaged") / "a")
    # With its checksums, nearly every damage of an E57 is found at once.
    unpack, pack = (content_of, paged) if name == "E57" else (bytes, bytes)
    whole = unpack(path.read_bytes())
    place = st.integers(0, len(whole) - 1)

    @given(
        edits=st.lists(st.tuples(place, st.binary(min_size=1, max_size=8)), max_size=4), end=place | st.none()
    )
    def check(edits: list[tuple[int, bytes]], end: int | None) -> None:
        damaged = bytearray(whole)
        for start, patch in edits:
            damaged[start : start + len(patch)] = patch
        path.write_bytes(pack(damaged[:end]))
        try:
            read(path)
        except InputError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017

    check()


LABEL_NAMES = ("ObjTag", "scalar_Classification", "label_mapped")


@pytest.mark.parametrize("name", LABEL_NAMES)
def test_a_drive_whose_labels_are_in_its_clouds(tmp_path: Path, name: str) -> None:
    cloud = little_cloud()
    vertices = cloud.astype([(name if field == "label" else field, kind) for field, kind in RECORD.descr])
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(tmp_path / "a.ply"))
    np.save(tmp_path / "a.npy", (np.arange(720 * 1280) % 3).reshape(720, 1280).astype(np.uint8))
    drive = DRIVE.replace("points/000000.bin", "a.ply\n  image_labels: a.npy")
    (tmp_path / "drive.yaml").write_text(drive)
    if name == "label_mapped":
        with pytest.raises(InputError) as complaint:
            read_observations(read_drive(tmp_path))
        assert str(complaint.value) == (
            f"{tmp_path}/drive.yaml: frames[a.ply].point_labels: found nothing, expected a file of class "
            "ids, or a field of the cloud named label, class or semantic; edges need none (--cue edges)"
        )
        return
    observations = read_observations(read_drive(tmp_path))
    ids = np.array(observations.point_class_names)[observations.clouds[0].classes]
    np.testing.assert_array_equal(ids.astype(int), np.delete(cloud["label"], [3, 8]))


@pytest.mark.parametrize(
    ("suffix", "place", "value", "complaint"),
    [
        (".las", 107, b"\xff\xff\xff\x7f", "promises 2147483647 points of 28 bytes in "),
        (
            ".las",
            100,
            b"\xff" * 4,
            "promises a header of 227 bytes and 4294967295 records before byte 227 of ",
        ),
        (".laz", 227 + 54 + 12, b"\1\0\0\0", "promises 1 chunks of 1 points of 2 items in "),
        (".laz", 227 + 54 + 32, b"\0\0", "promises 1 chunks of 50000 points of 0 items in "),
        (".laz", -8, b"\xff" * 4, "promises "),
        (".laz", 0, b"PLAS", "is not a readable LAS file: it has no LAS header"),
    ],
)
def test_a_las_that_promises_too_much_is_refused_at_once(
    tmp_path: Path, suffix: str, place: int, value: bytes, complaint: str
) -> None:
    path = write_las(suffix, "1.2")(little_cloud(), tmp_path / "a")
    damaged = bytearray(path.read_bytes())
    if place < 0:  # the number of chunks, from the start of their table
        (points,) = struct.unpack_from("<I", damaged, 96)
        place = struct.unpack_from("<q", damaged, points)[0] + 4
    damaged[place : place + len(value)] = value
    path.write_bytes(damaged)
    with pytest.raises(InputError) as error:
        read(path)
    assert str(error.value).startswith(f"{path}: {complaint}")


def test_data_that_no_compression_makes_smaller(tmp_path: Path) -> None:
    """Older versions of pypcd4 store them as they are in a compressed PCD."""
    columns = np.random.default_rng(0).normal(size=(3, 50)).astype("<f4")
    header = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 50\nHEIGHT 1\nPOINTS 50\n"
        "DATA binary_compressed\n"
    )
    stored = columns.tobytes()
    sizes = struct.pack("<II", len(stored), len(stored))
    (tmp_path / "a.pcd").write_bytes(header.encode() + sizes + stored)
    np.testing.assert_array_equal(read(tmp_path / "a.pcd").points, columns.T)


@pytest.mark.parametrize("name", ["a.bin", "a.pcd", "a.npz", "a.laz", "a.e57"])
def test_a_pointer_of_git_lfs_is_named(name: str, tmp_path: Path) -> None:
    if name == "a.e57":
        pytest.importorskip("pye57")
    pointer = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 1920000\n"
    (tmp_path / name).write_text(pointer)
    with pytest.raises(
        InputError, match="found a Git LFS pointer, expected the file itself: run `git lfs pull`"
    ):
        read(tmp_path / name)
    (tmp_path / "a.png").write_text(pointer)
    with pytest.raises(InputError, match="found a Git LFS pointer"):
        read_image(tmp_path / "a.png")
