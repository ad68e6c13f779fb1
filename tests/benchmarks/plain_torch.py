"""The refinement in plain torch, which `semcal experiment speed` compares with: one-hot maps, grid_sample, autograd.

python tests/benchmarks/plain_torch.py DRIVE --init FILE --estimator exact -o pose.npy

Float maps are averaged over blocks level by level and sampled bilinearly; Adam optimises the twist of the pose on
mini-batches. Levels, steps and batch sizes are those of semcal's estimator, so that kernels are compared and not
schedules; but nothing is dropped for being hidden, and nothing is polished.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from semcal_cli.config import FAR_DEG, ExactConfig, MineConfig, PyramidConfig
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import load_observations
from semcal_cli.formats import read_transform
from semcal_cli.refinement.network import DonskerVaradhan, StatisticsNetwork
from semcal_cli.refinement.projection import Projection
from semcal_cli.refinement.pyramid import pyramid_factors
from semcal_cli.refinement.se3 import exp_se3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--init", type=Path, required=True)
    parser.add_argument("--estimator", choices=["exact", "mine"], default="exact")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    observations = load_observations(read_drive(arguments.drive))
    clouds = observations.clouds
    num_x, num_y = len(observations.point_class_names), len(observations.image_class_names)
    images = torch.from_numpy(np.stack([image.classes for image in observations.images])).long()
    maps = functional.one_hot(images.clamp(max=num_y), num_y + 1)[..., :num_y].permute(0, 3, 1, 2).float()
    points = torch.from_numpy(np.concatenate([cloud.points for cloud in clouds])).double()
    classes = torch.from_numpy(np.concatenate([cloud.classes for cloud in clouds])).long()
    frames = torch.repeat_interleave(
        torch.arange(len(clouds)), torch.tensor([cloud.num_points for cloud in clouds])
    )
    labelled = classes != NO_CLASS
    points, classes, frames = points[labelled], classes[labelled], frames[labelled]
    camera = observations.camera
    projection = Projection(camera)
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    exact, mine = ExactConfig(), MineConfig()
    is_mine = arguments.estimator == "mine"
    steps, batch_size = (
        (mine.steps_per_level, mine.batch_size) if is_mine else (exact.steps, exact.batch_size)
    )
    rate, last = (
        (mine.learning_rate_pose, mine.final_rate) if is_mine else (exact.step_size, exact.final_step)
    )
    warm_up = mine.warm_up_steps if is_mine else 0
    network = StatisticsNetwork(num_x, num_y, mine.num_hidden, torch.Generator().manual_seed(0))
    bound = DonskerVaradhan(mine.mean_decay)
    theta = torch.optim.Adam(network.parameters(), mine.learning_rate_theta)
    pose = torch.from_numpy(read_transform(arguments.init))
    for factor in pyramid_factors(camera, PyramidConfig(coarsest_block_deg=FAR_DEG)):
        level = functional.avg_pool2d(maps, factor)
        p_camera = points @ pose[:3, :3].T + pose[:3, 3]
        pixels, holds = projection(p_camera)
        inside = torch.nonzero(holds & (pixels >= 0).all(1) & (pixels < size).all(1))[:, 0]
        block = torch.ones(6, dtype=torch.float64)
        block[:3] = p_camera[inside].norm(dim=1).median()
        block *= factor / camera.K[0][0]
        v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        adam = torch.optim.Adam([v], rate, betas=(0.9, 0.99))
        for step in range(warm_up + steps):
            cosine = 0.5 * (1.0 + math.cos(math.pi * max(step - warm_up, 0) / steps))
            adam.param_groups[0]["lr"] = rate * (last + (1.0 - last) * cosine)
            chosen = inside[torch.randint(len(inside), (batch_size,))]
            chosen = chosen[frames[chosen].argsort()]
            T = exp_se3(v * block) @ pose
            pixels, _ = projection(points[chosen] @ T[:3, :3].T + T[:3, 3])
            place = ((pixels + 0.5) / size * 2.0 - 1.0).float()
            counts = frames[chosen].bincount(minlength=len(level)).tolist()
            sampled = [
                functional.grid_sample(
                    level[frame : frame + 1], part[None, None], padding_mode="border", align_corners=False
                )[0, :, 0].T
                for frame, part in enumerate(place.split(counts))
                if len(part)
            ]
            y, x = torch.cat(sampled), classes[chosen]
            if not is_mine:
                joint = functional.one_hot(x, num_x).float().T @ y
                joint = joint / joint.sum()
                independent = joint.sum(1, keepdim=True) * joint.sum(0, keepdim=True)
                seen = joint > 0
                objective = (joint[seen] * (joint[seen] / independent[seen]).log()).sum()
            else:
                weights = y.detach().sum(1)
                weights = weights / weights.sum()
                p_x = torch.bincount(x, weights, minlength=num_x)
                statistics = network(y / y.sum(1, keepdim=True).clamp_min(0.02))
                joint = weights @ statistics.gather(1, x[:, None])[:, 0]
                _, objective = bound(joint, weights @ (statistics.exp() @ p_x))
            (-objective).backward()
            theta.step()
            if step >= warm_up:
                adam.step()
            adam.zero_grad()
            theta.zero_grad()
        warm_up = mine.warm_up_steps // 3 if is_mine else 0
        pose = (exp_se3(v * block) @ pose).detach()
    np.save(arguments.output, pose.numpy())


if __name__ == "__main__":
    main()
