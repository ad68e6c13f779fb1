"""The refinement in plain torch, which `speed.py` compares with: one-hot maps, grid_sample, autograd.

python tests/benchmarks/plain_torch.py DRIVE --init FILE --estimator exact -o pose.npy

Float maps are averaged over blocks level by level and sampled bilinearly; Adam optimises the twist of the pose on
mini-batches. Levels, steps and batch sizes are those of semcal's estimator, so that kernels are compared and not
schedules; but nothing is dropped for being hidden, and nothing is polished.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from semcal_cli.config import FAR_DEG, ExactConfig, PyramidConfig
from semcal_cli.config.mine_config import MineConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.refine.pyramid import pyramid_factors
from semcal_cli.estimation.refine.statistics_network import DonskerVaradhan, StatisticsNetwork
from semcal_cli.estimation.refine.torch_geometry import TorchProjection, exp_se3
from semcal_cli.formats import read_transform
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.reading import load_observations


@dataclass(frozen=True)
class Schedule:
    """Numbers of steps, and their lengths in blocks, which fall along a cosine to a share of the first."""

    steps: int
    batch_size: int
    rate: float
    final_share: float
    warm_up_steps: int = 0
    """Steps of the first level before the pose moves; later levels take a third of it."""

    def rate_at(self, step: int) -> float:
        cosine = 0.5 * (1.0 + math.cos(math.pi * max(step, 0) / self.steps))
        return self.rate * (self.final_share + (1.0 - self.final_share) * cosine)


class Estimator(Protocol):
    """What is maximised, from the classes of points and the shares of classes under them."""

    schedule: Schedule

    def objective(self, x: Tensor, y: Tensor) -> Tensor: ...

    def learn(self) -> None: ...


class Exact:
    """The mutual information of the joint histogram."""

    def __init__(self, num_x: int) -> None:
        config = ExactConfig()
        self.schedule = Schedule(config.steps, config.batch_size, config.step_size, config.final_step)
        self.num_x = num_x

    def objective(self, x: Tensor, y: Tensor) -> Tensor:
        joint = functional.one_hot(x, self.num_x).float().T @ y
        joint = joint / joint.sum()
        independent = joint.sum(1, keepdim=True) * joint.sum(0, keepdim=True)
        seen = joint > 0
        return (joint[seen] * (joint[seen] / independent[seen]).log()).sum()

    def learn(self) -> None:
        """A histogram has nothing to learn."""


class Mine:
    """The Donsker-Varadhan bound of a statistics network."""

    def __init__(self, num_x: int, num_y: int) -> None:
        config = MineConfig()
        self.schedule = Schedule(
            config.steps_per_level,
            config.batch_size,
            config.learning_rate_pose,
            config.final_rate,
            config.warm_up_steps,
        )
        self.num_x = num_x
        self.network = StatisticsNetwork(num_x, num_y, config.num_hidden, torch.Generator().manual_seed(0))
        self.bound = DonskerVaradhan(config.mean_decay)
        self.theta = torch.optim.Adam(self.network.parameters(), config.learning_rate_theta)

    def objective(self, x: Tensor, y: Tensor) -> Tensor:
        weights = y.detach().sum(1)
        weights = weights / weights.sum()
        p_x = torch.bincount(x, weights, minlength=self.num_x)
        statistics = self.network(y / y.sum(1, keepdim=True).clamp_min(0.02))
        joint = weights @ statistics.gather(1, x[:, None])[:, 0]
        _, objective = self.bound(joint, weights @ (statistics.exp() @ p_x))
        return objective

    def learn(self) -> None:
        self.theta.step()
        self.theta.zero_grad()


class Scene:
    """One-hot maps of all images, and the labelled points of all sweeps."""

    def __init__(self, observations: Observations) -> None:
        self.camera = observations.camera
        self.projection = TorchProjection(self.camera)
        self.size = torch.tensor([self.camera.width, self.camera.height], dtype=torch.float64)
        self.num_x, self.num_y = len(observations.point_class_names), len(observations.image_class_names)
        images = torch.from_numpy(np.stack([image.classes for image in observations.images])).long()
        one_hot = functional.one_hot(images.clamp(max=self.num_y), self.num_y + 1)[..., : self.num_y]
        self.maps = one_hot.permute(0, 3, 1, 2).float()
        clouds = observations.clouds
        points = torch.from_numpy(np.concatenate([cloud.points for cloud in clouds])).double()
        classes = torch.from_numpy(np.concatenate([cloud.classes for cloud in clouds])).long()
        num_points = torch.tensor([cloud.num_points for cloud in clouds])
        frames = torch.repeat_interleave(torch.arange(len(clouds)), num_points)
        labelled = classes != NO_CLASS
        self.points, self.classes, self.frames = points[labelled], classes[labelled], frames[labelled]

    def refine(self, pose: Tensor, estimator: Estimator) -> Tensor:
        """Ascend level by level, coarse to fine."""
        warm_up = estimator.schedule.warm_up_steps
        for factor in pyramid_factors(self.camera, PyramidConfig(coarsest_block_deg=FAR_DEG)):
            pose = self.ascend(factor, pose, estimator, warm_up)
            warm_up = estimator.schedule.warm_up_steps // 3
        return pose

    def ascend(self, factor: int, pose: Tensor, estimator: Estimator, warm_up: int) -> Tensor:
        """Ascend on the maps of blocks of `factor` pixels, with the points that are in the image at the start."""
        level, schedule = functional.avg_pool2d(self.maps, factor), estimator.schedule
        p_camera = self.points @ pose[:3, :3].T + pose[:3, 3]
        pixels, holds = self.projection(p_camera)
        inside = torch.nonzero(holds & (pixels >= 0).all(1) & (pixels < self.size).all(1))[:, 0]
        block = torch.ones(6, dtype=torch.float64)
        block[:3] = p_camera[inside].norm(dim=1).median()
        block *= factor / self.camera.K[0][0]
        v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        adam = torch.optim.Adam([v], schedule.rate, betas=(0.9, 0.99))
        for step in range(warm_up + schedule.steps):
            adam.param_groups[0]["lr"] = schedule.rate_at(step - warm_up)
            chosen = inside[torch.randint(len(inside), (schedule.batch_size,))]
            chosen = chosen[self.frames[chosen].argsort()]
            y = self.sample(level, chosen, exp_se3(v * block) @ pose)
            (-estimator.objective(self.classes[chosen], y)).backward()
            estimator.learn()
            if step >= warm_up:
                adam.step()
            adam.zero_grad()
        return (exp_se3(v * block) @ pose).detach()

    def sample(self, level: Tensor, chosen: Tensor, T: Tensor) -> Tensor:
        """Sample the shares of classes (N, num_y) under points that are sorted by frame."""
        pixels, _ = self.projection(self.points[chosen] @ T[:3, :3].T + T[:3, 3])
        place = ((pixels + 0.5) / self.size * 2.0 - 1.0).float()
        counts = self.frames[chosen].bincount(minlength=len(level)).tolist()
        sampled = [
            functional.grid_sample(
                level[frame : frame + 1], part[None, None], padding_mode="border", align_corners=False
            )[0, :, 0].T
            for frame, part in enumerate(place.split(counts))
            if len(part)
        ]
        return torch.cat(sampled)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--init", type=Path, required=True)
    parser.add_argument("--estimator", choices=["exact", "mine"], default="exact")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    scene = Scene(load_observations(read_drive(arguments.drive)))
    is_mine = arguments.estimator == "mine"
    estimator = Mine(scene.num_x, scene.num_y) if is_mine else Exact(scene.num_x)
    pose = scene.refine(torch.from_numpy(read_transform(arguments.init)), estimator)
    np.save(arguments.output, pose.numpy())


if __name__ == "__main__":
    main()
