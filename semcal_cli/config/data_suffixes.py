"""Suffixes of the files that a drive can be made of."""

from pathlib import Path

CLOUD_SUFFIXES = (
    ".pcd.bin", ".bin", ".pcd", ".ply", ".npy", ".npz", ".csv", ".pts", ".ptx", ".las", ".laz", ".e57",
)  # fmt: skip
POINT_LABEL_SUFFIXES = (".label", ".bin", ".npy", ".npz")
IMAGE_LABEL_SUFFIXES = (".png", ".npy", ".npz")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
_KINDS = {
    "an array": (".npy", ".npz"),
    "a point cloud": CLOUD_SUFFIXES,
    "an image": IMAGE_SUFFIXES,
    "point labels": (".label",),
    "packets of a LiDAR, which `ouster-cli source FILE save sweeps.csv` turns into sweeps if it is an Ouster": (
        ".pcap", ".pcapng", ".osf",
    ),
}  # fmt: skip
"""Kinds of data by their suffixes; the first kind that lists the suffix counts."""


def kind_of_data(path: Path) -> str | None:
    """Describe the data that a file holds by its suffix; None if it is no data file."""
    name = path.name.lower()
    return next((kind for kind, suffixes in _KINDS.items() if name.endswith(suffixes)), None)
