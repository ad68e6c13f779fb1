"""Consecutive sweeps and images of one synthetic street, along which a rig drives on an arc.

The core renders one long sweep of a rosette at one speed, whose parts are sweeps that follow one another, and images
at any time of it: where only its shutter is late, the street is the same. A speed that changes is a clock that runs
unevenly along the same way.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.files.documents import document_text
from semcal_cli.files.image_files import write_image
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing.bags.point_messages import PointTimes, Sweep
from semcal_cli.importing.stamps import tum_text
from semcal_cli.synthetic.street_motion import VehicleMotion
from semcal_cli.synthetic.synthesis import make_camera, make_renderer, mounting

NUM_SWEEPS, SWEEP_S = 30, 0.1
RAYS = 32
"""Rays that are fired together: a sweep has so many times the columns."""
FIRST_S = 100.0
"""Stamp of the first sweep."""
RECORD = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("time", "<f4")]


@dataclass(frozen=True)
class StreetConfig(SynthConfig):
    """A sweep that lasts as long as the drive."""

    sweep_s: ClassVar[float] = NUM_SWEEPS * SWEEP_S


class Timed(NamedTuple):
    """A twisted sweep."""

    points: npt.NDArray[np.float32]
    """(N, 3) metres, each in the LiDAR frame of its own time."""
    times_s: npt.NDArray[np.float64]
    """(N,) seconds after its start."""
    labels: npt.NDArray[np.uint32]
    """(N,)."""
    intensity: npt.NDArray[np.float32]
    """(N,) in [0, 1]."""

    def records(self) -> npt.NDArray[np.void]:
        """Records (1, N) of coordinates, intensities and times."""
        found = np.zeros((1, len(self.points)), RECORD)
        for axis, name in enumerate("xyz"):
            found[name] = self.points[:, axis]
        found["time"], found["intensity"] = self.times_s, self.intensity
        return found


class MovingStreet:
    """A drive of three seconds, or of another length; at no speed, one that stands."""

    def __init__(
        self,
        speed_m_s: float,
        yaw_rate_rad_s: float,
        seed: int,
        points: int = 40_000,
        width: int = 640,
        *,
        change: float = 0.0,
        readout_s: float = 0.0,
        num_sweeps: int = NUM_SWEEPS,
        **settings: Any,
    ) -> None:
        """Make the street.

        Args:
            speed_m_s: Mean speed.
            yaw_rate_rad_s: Mean turn.
            seed: Seed of the street and the mounting.
            points: Mean number of points of a sweep.
            width: Width of the images.
            change: Share by which the speed rises above its mean and falls below it within the drive.
            readout_s: Time that the shutter takes from the first line of an image to the last.
            num_sweeps: Number of sweeps; three seconds of them if not given.
            settings: Other settings of the LiDAR, the camera and the mounting.
        """
        of_length = type("_LongConfig", (StreetConfig,), {"sweep_s": num_sweeps * SWEEP_S})
        self.config: StreetConfig = of_length(
            **{
                "seed": seed,
                "pattern": "rosette",
                "channels": RAYS,
                "columns": num_sweeps * points // RAYS,
                "camera_azimuth_deg": 0.0,
                "width": width,
                "height": width * 9 // 16,
            }
            | settings
        )
        self.T_camera_lidar = mounting(self.config)
        self.camera = make_camera(self.config)
        self._motion = VehicleMotion(speed_m_s, yaw_rate_rad_s)
        self._change, self._readout_s = change, readout_s
        self._twist_per_s = [speed_m_s, 0.0, 0.0, 0.0, 0.0, yaw_rate_rad_s]

    @cached_property
    def _whole(self) -> core.RenderedFrame:
        return self._rendered(self.config)

    def _rendered(self, config: StreetConfig) -> core.RenderedFrame:
        return make_renderer(config, self.T_camera_lidar).frame(config.seed, 0, self._twist_per_s)

    def _even_s(self, seconds: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Time at which the rig would be at the same place at its mean speed; both count from the first sweep on."""
        turns = 2.0 * np.pi / self.config.sweep_s
        return seconds + self._change / turns * np.sin(turns * np.asarray(seconds))

    def speed_m_s(self, stamp_s: float) -> float:
        """Speed at a time."""
        wave = np.cos(2.0 * np.pi / self.config.sweep_s * (stamp_s - FIRST_S))
        return float(self._motion.speed_m_s * (1.0 + self._change * wave))

    @cached_property
    def _times_s(self) -> npt.NDArray[np.float64]:
        """Time of each point, from the first sweep on."""
        seconds = np.linspace(0.0, self.config.sweep_s, 30_001)
        return np.interp(self._whole.point_times, self._even_s(seconds), seconds)

    def sweep(self, index: int) -> Timed:
        """Cut out the sweep of a number, which starts at `stamp_s` of it."""
        times_s = self._times_s - index * SWEEP_S
        is_in = (times_s >= 0.0) & (times_s < SWEEP_S)
        points = self._whole.points[is_in]
        return Timed(points[:, :3], times_s[is_in], self._whole.point_labels[is_in], points[:, 3])

    def image(self, stamp_s: float) -> core.RenderedFrame:
        """Render the image whose reading begins at a time, with its labels."""
        begin_s, end_s = self._even_s([stamp_s - FIRST_S, stamp_s - FIRST_S + self._readout_s])
        late_s, readout_s = begin_s - 0.5 * self.config.sweep_s, end_s - begin_s
        return self._rendered(
            replace(self.config, columns=1, delay_ms=1e3 * late_s, readout_ms=1e3 * readout_s)
        )

    def pose(self, stamp_s: float) -> Pose:
        """Pose (4, 4) of the LiDAR at a time, in a fixed frame."""
        return self._motion.displacement(float(self._even_s(stamp_s - FIRST_S)))

    def errors(self, poses: dict[int, Pose]) -> tuple[float, float]:
        """Measure how far the last pose is from the truth, seen from the first, metres, and turned from it, degrees."""
        ends_ns = min(poses), max(poses)
        true, found = (
            inverse(first) @ last
            for first, last in (
                [self.pose(end / NS) for end in ends_ns],
                [poses[end] for end in ends_ns],
            )
        )
        error = inverse(true) @ found
        angle = np.arccos(np.clip(0.5 * (np.trace(error[:3, :3]) - 1.0), -1.0, 1.0))
        return float(np.linalg.norm(error[:3, 3])), float(np.degrees(angle))

    def write(
        self,
        folder: Path,
        count: int = NUM_SWEEPS,
        every: int = 1,
        late_s: float = 0.0,
        images: Container[int] = range(1_000_000),
    ) -> Path:
        """Write a drive of the first sweeps, or of every so many, with images of their middles, and no motion.

        The true poses lie beside it. Images are later than their stamps by some time, and `images` are the numbers of
        the sweeps that have one.
        """
        folder.mkdir(parents=True)
        frames = list[dict[str, Any]]()
        for index in range(0, count, every):
            sweep, start_s = self.sweep(index), stamp_s(index)
            middle_s = start_s + 0.5 * SWEEP_S
            names = f"{index:06d}"
            (folder / f"{names}.pcd").write_bytes(Sweep(sweep.records(), PointTimes()).pcd())
            sweep.labels.astype("<u4").tofile(folder / f"{names}.label")
            frame = {
                "points": f"{names}.pcd",
                "point_labels": f"{names}.label",
                "points_stamp": start_s,
            }
            if index in images:
                rendered = self.image(middle_s + late_s)
                write_image(rendered.image_labels, folder / f"{names}_labels.png")
                write_image(rendered.image_rgb[..., ::-1], folder / f"{names}.png")
                frame |= {
                    "image_labels": f"{names}_labels.png",
                    "image": f"{names}.png",
                    "image_stamp": middle_s,
                }
            frames.append(frame)
        last_s = FIRST_S + max(self.config.sweep_s, 3.0) + 2.0
        stamps_ns = range(round((FIRST_S - 1.0) * NS), round(last_s * NS), NS // 50)
        (folder / "true.txt").write_text(tum_text({each: self.pose(each / NS) for each in stamps_ns}))
        shutter = {"readout_s": self._readout_s} if self._readout_s else {}
        document = {
            "semcal_drive": 1,
            "camera": self.camera.model_dump(mode="json", exclude_unset=True) | shutter,
            "frames": frames,
            "ignore": {"points": [0], "image": [0]},
            "synchronization": "stamps",
            "T_camera_lidar": self.T_camera_lidar.tolist(),
        }
        (folder / "drive.yaml").write_text(document_text(document, "yaml"))
        return folder / "drive.yaml"


def stamp_s(index: int) -> float:
    """Time at which the sweep of a number starts."""
    return FIRST_S + index * SWEEP_S
