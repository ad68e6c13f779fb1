"""The objective as a torch module for your own code: mutual information, differentiable in the pose and all inputs.

The calibration itself does not use it, because its sampling and gradients are in Rust. This is the same objective in
plain torch: differentiable in the pose, in the label shares and features of points and pixels, and in the weights of a
statistics network, so that networks that make labels or features can be trained through it.
"""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.errors import check_torch

try:
    import torch
except ModuleNotFoundError:
    check_torch("semcal_cli.estimation.refine.objective")
    raise

from torch import Tensor
from torch.nn import functional

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.refine.torch_geometry import TorchProjection
from semcal_cli.observations.observations import NO_CLASS, Observations


class MutualInformation(torch.nn.Module):
    """I(X; Y), in nats, between the labels or features of points and those of the pixels under them.

    Without a statistics network, X and Y are shares of classes, and the result is the plug-in mutual information of the
    joint histogram. For one-hot labels it is exact; for soft labels it is that of ids drawn from the shares, a lower
    bound. With a network `F(x, y)`, X and Y may be any vectors, and the result is the Donsker-Varadhan bound (eq. 5),
    with y shuffled for the marginals; maximise it over the network's weights as well.
    """

    def __init__(
        self,
        camera: Camera,
        points: Sequence[Tensor],
        x: Sequence[Tensor],
        y: Sequence[Tensor],
        statistics: torch.nn.Module | None = None,
        seed: int = 0,
    ) -> None:
        """Take the points and the images of all frames.

        Args:
            camera: The camera of all frames.
            points: (N_i, 3) float64 of each frame, metres, LiDAR frame.
            x: (N_i, C_x) float32 of each frame: one-hot labels, shares or features of the points.
            y: (C_y, H, W) float32 of each frame: the same of the pixels.
            statistics: The network F, which maps x (N, C_x) and y (N, C_y) to (N,); None for the plug-in estimate.
            seed: Seed of the shuffling.
        """
        super().__init__()
        self.projection = TorchProjection(camera)
        self.size = camera.width, camera.height
        self.num_frames = len(points)
        for frame, tensors in enumerate(zip(points, x, y, strict=True)):
            for name, tensor in zip(("points", "x", "y"), tensors, strict=True):
                # Buffers follow the module to another device. They are data, and not saved with its state.
                self.register_buffer(f"{name}_{frame}", tensor, persistent=False)
        self.statistics = statistics
        self._generator = torch.Generator().manual_seed(seed)
        self._anchored: list[Tensor] = []

    @classmethod
    def from_observations(cls, observations: Observations) -> MutualInformation:
        """Make the objective from the labelled points and label images of observations, one-hot."""
        num_x, num_y = len(observations.point_class_names), len(observations.image_class_names)
        points, x = [], []
        for cloud in observations.clouds:
            is_labelled = cloud.classes != NO_CLASS
            points.append(torch.from_numpy(cloud.points[is_labelled]).double())
            x.append(functional.one_hot(torch.from_numpy(cloud.classes[is_labelled]).long(), num_x).float())
        # Pixels without a class are all zeros.
        y = [
            functional.one_hot(torch.from_numpy(image.classes).long().clamp(max=num_y), num_y + 1)[
                ..., :num_y
            ]
            .permute(2, 0, 1)
            .float()
            for image in observations.images
        ]
        return cls(observations.camera, points, x, y)

    @property
    def frames(self) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Points (N_i, 3) float64, x (N_i, C_x) and y (C_y, H, W) of each frame."""
        return [
            (getattr(self, f"points_{frame}"), getattr(self, f"x_{frame}"), getattr(self, f"y_{frame}"))
            for frame in range(self.num_frames)
        ]

    def anchor(self, T_camera_lidar: Tensor) -> int:
        """Choose the points that are in the image at a pose. They count until the next call.

        A point that leaves the image keeps counting, with the value of the nearest border pixel, so that pushing points
        out of the image does not raise the objective.

        Args:
            T_camera_lidar: (4, 4) float64.

        Returns:
            Number of points.
        """
        with torch.no_grad():
            self._anchored = [self._inside(points, T_camera_lidar) for points, _, _ in self.frames]
        return int(sum(inside.sum() for inside in self._anchored))

    def forward(self, T_camera_lidar: Tensor) -> Tensor:
        """Estimate the mutual information at a pose; if no points have been chosen, they are chosen there.

        Args:
            T_camera_lidar: (4, 4) float64.

        Returns:
            A scalar in nats, differentiable in the pose, in x and y, and in the network's weights.

        Raises:
            CalibrationError: no point is in an image, or none is on a labelled pixel.
        """
        x, y = self.pairs(T_camera_lidar)
        if len(y) == 0:
            raise CalibrationError("no overlap: no point lands on an image")
        return _plug_in(x, y) if self.statistics is None else self._donsker_varadhan(self.statistics, x, y)

    def _donsker_varadhan(self, statistics: torch.nn.Module, x: Tensor, y: Tensor) -> Tensor:
        order = torch.randperm(len(y), generator=self._generator).to(y.device)
        shuffled = statistics(x, y[order])
        count = torch.tensor(float(len(y)), device=y.device)
        # E_p(x,y)[F] - log E_p(x)p(y)[exp F] (eq. 5).
        bound: Tensor = statistics(x, y).mean() - (shuffled.logsumexp(0) - count.log())
        return bound

    def pairs(self, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        """Pair the chosen points with the pixels under them; if no points have been chosen, they are chosen here.

        Args:
            T_camera_lidar: (4, 4) float64.

        Returns:
            x of the points (N, C_x), and y of the pixels (N, C_y), bilinear between pixel centres.
        """
        if not self._anchored:
            self.anchor(T_camera_lidar)
        pairs = [
            (x[chosen], self._sample(y, self._project(points[chosen], T_camera_lidar)[0]))
            for (points, x, y), chosen in zip(self.frames, self._anchored, strict=True)
        ]
        return torch.cat([x for x, _ in pairs]), torch.cat([y for _, y in pairs])

    def _project(self, points: Tensor, T_camera_lidar: Tensor) -> tuple[Tensor, Tensor]:
        pixels, holds = self.projection(points @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3])
        return pixels, holds

    def _inside(self, points: Tensor, T_camera_lidar: Tensor) -> Tensor:
        pixels, holds = self._project(points, T_camera_lidar)
        inside: Tensor = (
            holds & (pixels >= -0.5).all(1) & (pixels < pixels.new_tensor(self.size) - 0.5).all(1)
        )
        return inside

    def _sample(self, y: Tensor, pixels: Tensor) -> Tensor:
        place = ((pixels + 0.5) / pixels.new_tensor(self.size) * 2.0 - 1.0).to(y.dtype)
        sampled = functional.grid_sample(
            y[None], place[None, None], mode="bilinear", padding_mode="border", align_corners=False
        )
        return sampled[0, :, 0].T


def _plug_in(x: Tensor, y: Tensor) -> Tensor:
    """Compute the mutual information of the joint histogram of shares (N, C_x) and (N, C_y)."""
    # The shares of a pixel without a class are zeros, so that a pair weighs as much as its labelled part.
    joint = x.T @ y
    if not joint.sum() > 0.0:
        raise CalibrationError("no overlap: no point lands on a pixel that can be compared with it")
    joint = joint / joint.sum()
    independent = joint.sum(1, keepdim=True) * joint.sum(0, keepdim=True)
    is_observed = joint > 0.0
    information: Tensor = (joint[is_observed] * (joint[is_observed] / independent[is_observed]).log()).sum()
    return information
