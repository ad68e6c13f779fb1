"""Whether a drive and its settings allow for what is known and what is estimated beside the labels' pose."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.assessment.priors import Prior
from semcal_cli.config import RefinementConfig
from semcal_cli.drive.camera import check_intrinsics
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.motion import twists_per_s
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import InputError


def is_polished(observations: Observations, config: RefinementConfig) -> bool:
    """Whether poses are polished: those of features are not, which lack the exact mutual information."""
    return config.is_polished and not observations.has_vectors


def check_beside_pose(data: LoadedDrive, config: RefinementConfig, priors: Sequence[Prior] = ()) -> None:
    """Check that priors, intrinsics and the clock go with the drive and with the polish.

    Raises:
        InputError: there are priors without a polish; or something is to be estimated beside the pose, and the lens has
            not one of the intrinsics, the drive has no motion for the offset of the clock, or priors, features or a
            pose that is not polished exclude the estimate.
    """
    path, jointly = data.drive.path, config.jointly
    is_finished = is_polished(data.observations, config)
    if priors and not is_finished:
        raise InputError(
            f"{priors[0].name}: is weighed by the polish, which features and is_polished=False exclude"
        )
    if not jointly.is_asked:
        return
    option = "--refine-intrinsics" if jointly.intrinsics else "--estimate-delay"
    check_intrinsics(jointly.intrinsics, data.observations.camera, f"{path}: --refine-intrinsics")
    if not is_finished:
        raise InputError(f"{option}: follows the polish, which features and is_polished=False exclude")
    if priors:
        raise InputError(
            f"{option}: found {priors[0].name}, needed none: the two are not weighed together yet"
        )
    if jointly.with_delay and twists_per_s(data.observations) is None:
        raise InputError(
            f"{path}: motion: found no direction of motion, needed poses or a twist for --estimate-delay"
        )
