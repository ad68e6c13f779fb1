import numpy as np
import torch
from conftest import triples
from hypothesis import given
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from torch.autograd import gradcheck

from semcal_cli.refinement.torch_geometry import exp_se3, generators

ROUND_OFF = 1e-10


@given(rho=triples(5.0), phi=triples(3.0))
def test_exponential_of_a_twist(rho: tuple[float, ...], phi: tuple[float, ...]) -> None:
    twist = torch.tensor([*rho, *phi], dtype=torch.float64)
    T = exp_se3(twist).numpy()
    np.testing.assert_allclose(T[:3, :3], Rotation.from_rotvec(phi).as_matrix(), atol=ROUND_OFF)
    np.testing.assert_allclose(T @ exp_se3(-twist).numpy(), np.eye(4), atol=ROUND_OFF)
    np.testing.assert_allclose(T, expm(np.einsum("i,ijk->jk", twist, generators(twist))), atol=ROUND_OFF)


def test_translation_comes_first() -> None:
    twist = torch.tensor([1.0, 2.0, 3.0, 0.0, 0.0, 0.0], dtype=torch.float64)
    np.testing.assert_array_equal(exp_se3(twist)[:3, 3], [1.0, 2.0, 3.0])


def test_gradient() -> None:
    twist = torch.tensor([0.3, -0.2, 0.5, 0.1, 0.4, -0.3], dtype=torch.float64, requires_grad=True)
    assert gradcheck(exp_se3, twist)
