"""Refinement of a pose by gradient ascent on the mutual information of labels (Alg. 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from semcal_cli import _core
from semcal_cli.camera import core_camera
from semcal_cli.errors import CalibrationError
from semcal_cli.mine import DonskerVaradhan, StatisticsNetwork
from semcal_cli.observations import NO_CLASS, Observations
from semcal_cli.poses import Pose
from semcal_cli.projection import Projection
from semcal_cli.sampling import ShareMaps
from semcal_cli.se3 import exp_se3


@dataclass(frozen=True)
class RefinementConfig:
    """Defaults of Alg. 1. Steps of the pose are in blocks of the level, so that they fit any lens and size."""

    factors: tuple[int, ...] = (32, 16, 8, 4, 2, 1)
    steps_per_level: int = 150
    batch_size: int = 4096
    num_hidden: int = 48
    warm_up_steps: int = 50
    learning_rate_theta: float = 5e-3
    learning_rate_pose: float = 0.1
    final_rate: float = 0.05
    mean_decay: float = 0.9
    visible_from_factor: int = 4
    center_pull: float = 0.0


@dataclass(frozen=True)
class Batch:
    points: Tensor
    classes: Tensor
    frames: Tensor


def select(observations: Observations, T_camera_lidar: Pose, drop_hidden: bool) -> Batch:
    camera = core_camera(observations.camera)
    points, classes, frames = [], [], []
    for frame in range(observations.num_frames):
        p, c = observations.points[frame], observations.point_classes[frame]
        pixels, _, hidden = _core.land(camera, p, T_camera_lidar)
        keep = ~np.isnan(pixels[:, 0]) & (c != NO_CLASS)
        if drop_hidden:
            keep &= ~hidden
        uv = (np.nan_to_num(pixels) + 0.5).astype(int)
        img = observations.image_classes[frame]
        keep &= img[np.clip(uv[:, 1], 0, img.shape[0] - 1), np.clip(uv[:, 0], 0, img.shape[1] - 1)] != NO_CLASS
        points.append(p[keep])
        classes.append(c[keep])
        frames.append(np.full(keep.sum(), frame))
    return Batch(
        torch.from_numpy(np.concatenate(points)).double(),
        torch.from_numpy(np.concatenate(classes)).long(),
        torch.from_numpy(np.concatenate(frames)).long(),
    )


def refine(obs: Observations, T_init: Pose, cfg: RefinementConfig, seed: int = 0, log=None) -> Pose:
    torch.manual_seed(seed)
    g = torch.Generator().manual_seed(seed)
    projection = Projection(obs.camera)
    net = StatisticsNetwork(len(obs.point_class_names), len(obs.image_class_names), cfg.num_hidden, g)
    bound = DonskerVaradhan(cfg.mean_decay)
    T = torch.from_numpy(T_init)
    focal = projection.focal.mean().item()
    theta_opt = torch.optim.Adam(net.parameters(), cfg.learning_rate_theta)
    for level, factor in enumerate(cfg.factors):
        batch_all = select(obs, T.numpy(), factor <= cfg.visible_from_factor)
        n = len(batch_all.classes)
        p_x = torch.bincount(batch_all.classes, minlength=len(obs.point_class_names)).float() / n
        maps = ShareMaps(obs.image_classes, len(obs.image_class_names), factor)
        rng = (T[:3, :3] @ batch_all.points.T + T[:3, 3:]).norm(dim=0).median().item()
        scale = torch.tensor([rng] * 3 + [1.0] * 3, dtype=torch.float64) * factor / focal
        xi = torch.zeros(6, dtype=torch.float64, requires_grad=True)
        pose_opt = torch.optim.Adam([xi], cfg.learning_rate_pose, betas=(0.9, 0.99))
        warm = cfg.warm_up_steps if level == 0 else cfg.warm_up_steps // 3
        vals = []
        for step in range(warm + cfg.steps_per_level):
            k = max(0, step - warm) / cfg.steps_per_level
            rate = cfg.final_rate + (1 - cfg.final_rate) * 0.5 * (1 + np.cos(np.pi * k))
            pose_opt.param_groups[0]["lr"] = cfg.learning_rate_pose * rate
            theta_opt.param_groups[0]["lr"] = cfg.learning_rate_theta * (rate if level == len(cfg.factors) - 1 else 1)
            i = torch.randint(n, (min(cfg.batch_size, n),), generator=g)
            Tc = exp_se3(xi * scale) @ T
            pc = batch_all.points[i] @ Tc[:3, :3].T + Tc[:3, 3]
            px, holds = projection(pc)
            y = maps.sample(batch_all.frames[i], px)
            value, obj = bound(net(y), batch_all.classes[i], p_x)
            center = -Tc[:3, :3].T @ Tc[:3, 3]
            loss = -obj + cfg.center_pull * factor / 32 * (center @ center)
            theta_opt.zero_grad()
            pose_opt.zero_grad()
            loss.backward()
            theta_opt.step()
            if step >= warm:
                pose_opt.step()
            vals.append(value.item())
        T = (exp_se3(xi.detach() * scale) @ T).detach()
        if log:
            log(factor, T.numpy(), float(np.mean(vals[-30:])), n)
    return T.numpy()
