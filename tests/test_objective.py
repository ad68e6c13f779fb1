from pathlib import Path

import pytest
import torch
from conftest import make_pose

from semcal_cli import core
from semcal_cli.config import ExactConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.refine.objective import MutualInformation
from semcal_cli.estimation.refine.torch_geometry import exp_se3
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations


class Bilinear(torch.nn.Module):
    """F(x, y) = x' W y."""

    def __init__(self, num_x: int, num_y: int) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(num_x, num_y))

    def forward(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        return (x @ self.weight * y).sum(1)


def test_the_value_is_that_of_the_core(fine_street: Path, street_truth: Pose) -> None:
    """All points count here, hidden ones, too."""
    observations = load_observations(read_drive(fine_street))
    objective = MutualInformation.from_observations(observations)
    value = objective(torch.from_numpy(street_truth))
    config = ExactConfig(steps=0, max_points=10**9)
    (there,) = core.align(
        observations.without_edge_band.core, [street_truth], config, factor=1, visible_only=False, seed=0
    )
    # The core's has its bias taken off.
    assert value.item() == pytest.approx(there.value, abs=2e-3)
    assert objective.anchor(torch.from_numpy(street_truth)) == pytest.approx(there.num_points, rel=1e-3)


def test_its_gradient_is_that_of_differences(street_observations: Observations, street_truth: Pose) -> None:
    objective = MutualInformation.from_observations(street_observations)
    off = torch.from_numpy(make_pose((0.003, 0.004, -0.002), (0.02, 0.0, 0.03)) @ street_truth)
    objective.anchor(off)
    v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    objective(exp_se3(v) @ off).backward()
    assert v.grad is not None
    step = 1e-3  # sampling is piecewise bilinear: wide enough to average over many points
    for axis in torch.eye(6, dtype=torch.float64)[3:] * step:
        with torch.no_grad():
            difference = objective(exp_se3(axis) @ off) - objective(exp_se3(-axis) @ off)
        assert (v.grad @ axis / step).item() == pytest.approx(difference.item() / (2.0 * step), rel=0.3)


def test_nothing_in_the_image_is_an_error(street_observations: Observations) -> None:
    objective = MutualInformation.from_observations(street_observations)
    with pytest.raises(CalibrationError, match="no overlap"):
        objective(torch.eye(4, dtype=torch.float64))  # into the sky


def test_its_data_follow_it(street_observations: Observations) -> None:
    objective = MutualInformation.from_observations(street_observations).to("meta")
    assert {buffer.device.type for buffer in objective.buffers()} == {"meta"}
    assert all(name.startswith("projection.") for name in objective.state_dict())


def test_a_network_bounds_the_plug_in_from_below(fine_street: Path, street_truth: Pose) -> None:
    observations = load_observations(read_drive(fine_street))
    exact = MutualInformation.from_observations(observations)
    T = torch.from_numpy(street_truth)
    points, x, y = exact.frames[0]
    points, x = points[::10], x[::10]
    exact = MutualInformation(observations.camera, [points], [x], [y])
    network = Bilinear(x.shape[1], y.shape[0])
    bound = MutualInformation(observations.camera, [points], [x], [y], network)
    optimizer = torch.optim.Adam(network.parameters(), 0.3)
    for _ in range(60):
        optimizer.zero_grad()
        (-bound(T)).backward()
        optimizer.step()
    limit, learned = exact(T).item(), bound(T).item()
    assert 0.6 * limit < learned < limit + 0.05
