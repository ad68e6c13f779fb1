"""Suffixes of the files that a drive can be made of."""

from pathlib import Path

CLOUD_SUFFIXES = (
    ".pcd.bin", ".bin", ".pcd", ".ply", ".npy", ".npz", ".csv", ".pts", ".ptx", ".las", ".laz", ".e57",
)  # fmt: skip
POINT_LABEL_SUFFIXES = (".label", ".bin", ".npy", ".npz")
IMAGE_LABEL_SUFFIXES = (".png", ".npy", ".npz")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


def stem(path: Path) -> str:
    """Remove the suffix from a file's name; `.pcd.bin` counts as one suffix."""
    suffix = next((suffix for suffix in CLOUD_SUFFIXES if path.name.endswith(suffix)), path.suffix)
    return path.name.removesuffix(suffix)
