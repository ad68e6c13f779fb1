"""LiDAR-camera extrinsic calibration from ordinary driving data, without targets or an initial guess.

    import semcal_cli as semcal

    calibration = semcal.calibrate("my_drive")
    calibration.save("calibration.yaml")

Names are imported on first use, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING
from warnings import warn

if TYPE_CHECKING:
    from semcal_cli.api.calls import (
        assess as assess,
        calibrate as calibrate,
        refine as refine,
        verify as verify,
    )
    from semcal_cli.api.many import batch as batch
    from semcal_cli.api.results import Calibration as Calibration, read_calibration as read_calibration
    from semcal_cli.config import (
        AdjustmentConfig as AdjustmentConfig,
        CalibrationConfig as CalibrationConfig,
        InitializationConfig as InitializationConfig,
        Limits as Limits,
        RefinementConfig as RefinementConfig,
    )
    from semcal_cli.drive.camera import Camera as Camera
    from semcal_cli.drive.document import Drive as Drive, read_drive as read_drive
    from semcal_cli.drive.held_arrays import ArrayInput as ArrayInput
    from semcal_cli.errors import (
        CalibrationError as CalibrationError,
        InputError as InputError,
        SemcalError as SemcalError,
    )
    from semcal_cli.estimation.adjust.priors import Prior as Prior
    from semcal_cli.estimation.search.initial_pose import InitialPose as InitialPose
    from semcal_cli.formats import (
        convert as convert,
        read_transform as read_transform,
        write_transform as write_transform,
    )
    from semcal_cli.formats.format import FormatOptions as FormatOptions
    from semcal_cli.geometry.poses import compare_poses as compare_poses
    from semcal_cli.observations.loading import load as load
    from semcal_cli.result.calibration_document import write_calibration as write_calibration

    __version__: str

_MODULES = {
    "AdjustmentConfig": "config",
    "ArrayInput": "drive.held_arrays",
    "Calibration": "api.results",
    "CalibrationConfig": "config",
    "CalibrationError": "errors",
    "Camera": "drive.camera",
    "Drive": "drive.document",
    "FormatOptions": "formats.format",
    "InitialPose": "estimation.search.initial_pose",
    "InitializationConfig": "config",
    "InputError": "errors",
    "Limits": "config",
    "Prior": "estimation.adjust.priors",
    "RefinementConfig": "config",
    "SemcalError": "errors",
    "assess": "api.calls",
    "batch": "api.many",
    "calibrate": "api.calls",
    "compare_poses": "geometry.poses",
    "convert": "formats",
    "load": "observations.loading",
    "read_calibration": "api.results",
    "read_drive": "drive.document",
    "read_transform": "formats",
    "refine": "api.calls",
    "verify": "api.calls",
    "write_calibration": "result.calibration_document",
    "write_transform": "formats",
}
"""Where the public names are defined."""

_RENAMED = {"JointlyConfig": "AdjustmentConfig"}
"""Public names of earlier versions, which stay for two minor versions."""
__all__ = [*_MODULES, "__version__"]


def __getattr__(name: str) -> object:
    """Import a public name on first use."""
    if name == "__version__":
        from importlib.metadata import version

        return version("semcal")
    if name in _RENAMED:
        warn(f"semcal.{name} is now semcal.{_RENAMED[name]}", DeprecationWarning, stacklevel=2)
        name = _RENAMED[name]
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    """List the public names."""
    return __all__
