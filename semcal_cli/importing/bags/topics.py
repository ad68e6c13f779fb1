"""The topics of a recording that make a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.config.directions import CameraFrame
from semcal_cli.drive.lidar import Lidar
from semcal_cli.errors import ChoiceError, InputError, check_installed, counted, listed
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.image_messages import Bayer
from semcal_cli.importing.bags.messages import (
    CAMERA_INFO,
    CLOUDS,
    IMAGES,
    ODOMETRY,
    OUSTER,
    POSE,
    TRANSFORMS,
    VELODYNE,
    VIDEOS,
    Topic,
)
from semcal_cli.importing.bags.transforms import TF_STATIC

RECTIFIED = "image_rect"
"""Start of the name of a topic with rectified images (image_proc)."""
MAX_FRAMES = 70
"""Default of the largest number of frames."""
MAX_GAP_S = 0.05
"""Default of the largest time between a sweep and its image, seconds."""


@dataclass(frozen=True)
class BagRequest:
    """What the user asks of a recording."""

    paths: Sequence[Path]
    """Its files or its folder."""
    points: str | None = None
    """Topic of the sweeps; None for the only one."""
    image: str | None = None
    """Topic of the images; None for the only one."""
    camera_info: str | None = None
    """Topic of the intrinsics; None for the one beside the images, or the only one."""
    intrinsics: Path | None = None
    """File of the intrinsics, instead of a topic."""
    max_frames: int | None = None
    """Largest number of frames; None for `MAX_FRAMES`, or for all that `every_s` asks for."""
    every_s: float | None = None
    """Time from one frame to the next, seconds; None spreads them so that scenes differ."""
    by_receipt: bool = False
    """Whether times are those at which messages were received, rather than those of their headers."""
    max_gap_s: float = MAX_GAP_S
    """Largest time between a sweep and its image, seconds."""
    motion: str | None = None
    """Topic of the motion; `none` for none, None for the only one."""
    motion_frame: str | None = None
    """Frame whose poses that topic holds; None for the one that its messages name."""
    odometry: bool = False
    """Whether the motion is estimated from the sweeps if no topic states it."""
    frame: CameraFrame | None = None
    """Axes of the images' frame in the transforms; None for optical ones, with a remark if they seem to be others."""
    is_resized: bool = False
    """Whether images were resized after the camera was calibrated, so that K is converted to their size."""
    bayer: Bayer | None = None
    """Pattern of images that are mosaics; None for those that the messages name."""
    lidar: Lidar | None = None
    """How the LiDAR turns, which gives the times of points that have none, and where its rays start."""
    around_s: float | None = None
    """Also keep all sweeps within half of this time from each frame, without images, seconds."""
    sweeps_ns: Mapping[int, int] | None = None
    """Stamps of the sweeps to take, where another camera has chosen them, and when these were received; None chooses
    them."""


@dataclass(frozen=True)
class Topics:
    """The topics that a drive is made of."""

    points: Topic
    """The sweeps."""
    image: Topic
    """The images."""
    camera_info: Topic | None
    """The intrinsics; None if a file holds them."""
    is_beside: bool = True
    """Whether the topic of the intrinsics is beside that of the images, or was named by the user."""
    duplicates: tuple[Topic, ...] = ()
    """Topics that hold the same sweeps or images in another encoding and that the user did not name."""

    @property
    def is_rectified(self) -> bool:
        """Whether the images are rectified, by the name of their topic."""
        parts = self.image.name.split("/")
        return self.camera_info is not None and any(part.startswith(RECTIFIED) for part in parts)


TRANSPORTS = (
    "compressed",
    "compressedDepth",
    "theora",
    "zstd",
    "avif",
    "draco",
    "zlib",
    "ffmpeg",
    "foxglove",
)
"""Names below a topic under which the plugins of image_transport and point_cloud_transport publish it again."""
REPLAY_OUSTER = {
    True: "`roslaunch ouster_ros replay.launch bag_file:=BAG metadata:=JSON` while `rosbag record -a` runs",
    False: "`ros2 launch ouster_ros replay.launch.xml bag_file:=BAG` while `ros2 bag record -a` runs",
}
"""How packets of an Ouster are replayed as sweeps, in ROS 1 and in ROS 2; see the launch files of ouster_ros. Its
replay in ROS 1 reads the sensor's metadata from a file unless the bag has a topic of them."""
ALL_CAMERAS = "--all-cameras"
"""Option that makes a rig of all topics of images."""
USES = {
    "sweeps": CLOUDS,
    "images": IMAGES,
    "intrinsics": (CAMERA_INFO,),
    "motion": (ODOMETRY, POSE, *TRANSFORMS),
}
"""Types of messages by their use."""
CHOSEN = {
    "points": (CLOUDS, "--points", "sweeps (PointCloud2, Livox CustomMsg, VelodyneScan)"),
    "image": (IMAGES, "--image", "images (Image, CompressedImage, video)"),
}
"""Types of the topics of a pair, the option that names one, and what it holds, by the fields of `BagRequest`."""
OF_INTRINSICS = (
    [CAMERA_INFO],
    "--camera-info",
    "intrinsics (CameraInfo)",
    "; expected one, or --intrinsics FILE",
)
"""The same of the intrinsics, and what to do where there are none."""


def choose_topics(bag: Bag, request: BagRequest) -> Topics:
    """Choose the topics that the user names, or the only ones of their kind.

    Raises:
        ChoiceError: there are several pairs of sweeps and images, or topics of intrinsics.
        InputError: a kind has no topic, or there is none of a given name.
    """
    sweeps, images = _pairs(bag, request)
    if len(sweeps) * len(images) > 1:
        raise _several(bag, request, sweeps, images)
    (points,), (image,) = sweeps, images
    if points.is_a([VELODYNE]):
        check_installed(points.name, "velodyne_decoder", "velodyne")
    if image.is_a(VIDEOS):
        check_installed(image.name, "av", "bag")
    duplicates = (
        *(_others_of(bag.of_types(CLOUDS), points) if request.points is None else ()),
        *(_others_of(bag.of_types(IMAGES), image) if request.image is None else ()),
    )
    if request.intrinsics is not None:
        return Topics(points, image, None, duplicates=duplicates)
    info_beside = _info_beside(bag, image) if request.camera_info is None else None
    infos = [info_beside] if info_beside else _candidates(bag, request.camera_info, *OF_INTRINSICS)
    if len(infos) > 1:
        choices = [("--camera-info", topic.name) for topic in infos]
        found = f"{bag.paths[0]}: found {len(infos):,} topics of intrinsics, none beside {image.name}"
        raise ChoiceError(found, f"one of: {listed(topic.name for topic in infos)}", choices)
    (info,) = infos
    return Topics(
        points,
        image,
        info,
        is_beside=info_beside is not None or request.camera_info is not None,
        duplicates=duplicates,
    )


def topics_of_cameras(bag: Bag, request: BagRequest) -> list[Topic]:
    """List the topics of images, without copies in another encoding, for the only topic of sweeps, or the named one.

    Raises:
        ChoiceError: there are several topics of sweeps.
        InputError: there are none, or none of images, or images have no intrinsics beside them.
    """
    sweeps, images = _pairs(bag, request)
    for image in images:
        if _info_beside(bag, image) is None:
            raise InputError(
                f"{bag.paths[0]}: found no camera_info beside {image.name}, expected one for each camera; import the "
                "cameras one by one with --image and --camera-info or --intrinsics"
            )
    if len(sweeps) > 1:
        choices = [("--points", topic.name) for topic in sweeps]
        found = f"{bag.paths[0]}: found {counted(len(sweeps), 'topic')} of sweeps"
        raise ChoiceError(found, f"one of: {listed(topic.name for topic in sweeps)}", choices)
    return images


def _pairs(bag: Bag, request: BagRequest) -> tuple[list[Topic], list[Topic]]:
    sweeps, images = (_candidates(bag, getattr(request, use), *of) for use, of in CHOSEN.items())
    return sweeps, images


def _candidates(
    bag: Bag, name: str | None, types: Sequence[str], option: str, kind: str, advice: str = ""
) -> list[Topic]:
    """List the topics of a kind, without copies in another encoding, or the one that the user names.

    Raises:
        InputError: there is none.
    """
    topics = bag.of_types(types)
    if name is not None:
        matches = [topic for topic in topics if topic.name == name]
        if not matches:
            names = listed(topic.name for topic in topics)
            raise InputError(f"{option}: found no topic {name!r} of {kind}, expected one of: {names}")
        return matches
    if not topics:
        others = listed(sorted({topic.type for topic in bag.topics if topic.span.num_messages}))
        if types is CLOUDS and (packets := bag.of_types(OUSTER)):
            replay = REPLAY_OUSTER[packets[0].is_ros1]
            advice = f"; to turn packets of an Ouster into sweeps, replay them: {replay}"
        raise InputError(f"{bag.paths[0]}: found no topic of {kind}, only {others}{advice}")
    duplicates = {other for topic in topics for other in _others_of(topics, topic)}
    return [topic for topic in topics if topic not in duplicates]


def _several(bag: Bag, request: BagRequest, sweeps: Sequence[Topic], images: Sequence[Topic]) -> ChoiceError:
    """Make the error that lists all pairs of topics of which one has to be chosen."""

    def words(option: str, named: str | None, topics: Sequence[Topic], topic: Topic) -> tuple[str, ...]:
        return (option, topic.name) if named is None and len(topics) > 1 else ()

    pairs = [
        (*words("--points", request.points, sweeps, points), *words("--image", request.image, images, image))
        for points in sweeps
        for image in images
    ]
    counts = " and ".join(
        f"{counted(len(topics), 'topic')} of {kind}"
        for topics, kind in ((sweeps, "sweeps"), (images, "images"))
    )
    expected = f"one pair: {listed(map(' '.join, pairs))}"
    is_open = request.intrinsics is None and request.camera_info is None and request.around_s is None
    all_cameras = [(ALL_CAMERAS,)] if is_open and len(sweeps) == 1 else []
    return ChoiceError(f"{bag.paths[0]}: found {counts}", expected, [*pairs, *all_cameras])


def _others_of(topics: Sequence[Topic], topic: Topic) -> list[Topic]:
    """List the topics that hold the messages of a topic in another encoding, as image_raw/compressed."""
    return [
        other for other in topics if other.name in {f"{topic.name}/{transport}" for transport in TRANSPORTS}
    ]


def _info_beside(bag: Bag, image: Topic) -> Topic | None:
    """Find the camera_info beside image_raw, whose compressed images are a level deeper (image_transport)."""
    folder = Path(image.name).parent
    names = [f"{str(parent).rstrip('/')}/camera_info" for parent in (folder, folder.parent)]
    topics = {topic.name: topic for topic in bag.of_types([CAMERA_INFO])}
    return next((topics[name] for name in names if name in topics), None)


def roles(bag: Bag) -> dict[Topic, str]:
    """Describe what each usable topic is used for."""
    return {
        topic: "fixed frames" if topic.name == TF_STATIC else use
        for use, types in USES.items()
        for topic in bag.of_types(types)
    }
