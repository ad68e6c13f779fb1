"""The folders that my robot records."""

from semcal_cli.formats import read_transform
from semcal_cli.formats.camera_block import read_intrinsics
from semcal_cli.importing.dataset_tree import files_by_stem
from semcal_cli.importing.recording import Recording, Request, join_frames


def read(request: Request) -> Recording:
    """My robot: ROOT/clouds and ROOT/images, and its camera and its mounting beside them."""
    root = request.root
    frames = join_frames(
        files_by_stem(root / "clouds", ".bin"),
        image=files_by_stem(root / "images", ".png"),
        missing=f"{root}: found no cloud with an image of its name",
    )
    return Recording(
        camera=read_intrinsics(root / "camera.yaml"),
        frames=frames,
        T_camera_lidar=read_transform(root / "transform.yaml"),
    )
