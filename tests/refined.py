"""A calibration that holds a camera and a clock, as one that estimated them together with its pose does."""

from typing import Any

from semcal_cli.drive.camera import Camera
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.refined_camera import Clock, Intrinsic, RefinedCamera

GAIN, GAIN_SIGMA = 0.0123, 0.001
GIVEN_S, LATER_S = 0.005, 0.0231


def spoiled(camera: Camera, scale: float = 1.03) -> Camera:
    """The same camera with focal lengths that are wrong."""
    return camera.zoomed(scale)


def intrinsic(given: float, found: float, half_width: float | None) -> Intrinsic:
    """An estimate; without a half width, the data do not determine it."""
    return Intrinsic(
        given=given,
        found=found,
        sigma=None if half_width is None else half_width / 2.0,
        half_width_95=half_width,
        is_determined=half_width is not None,
    )


def refined_camera(given: Camera, found: Camera, *, is_kept: bool = True) -> RefinedCamera:
    """A camera whose fx and fy were determined and whose cx was not."""
    return RefinedCamera(
        is_kept=is_kept,
        held_out_gain_nats=GAIN,
        held_out_sigma_nats=GAIN_SIGMA,
        found=found,
        intrinsics={
            "fx": intrinsic(given.K[0][0], found.K[0][0], 0.42),
            "fy": intrinsic(given.K[1][1], found.K[1][1], 0.5),
            "cx": intrinsic(given.K[0][2], found.K[0][2], None),
        },
        joint_covariance=None,
    )


def clock(*, is_determined: bool = True) -> Clock:
    """A clock that is off, or that nothing is known of."""
    return Clock(
        time_offset_s=LATER_S if is_determined else 0.0,
        given_s=GIVEN_S if is_determined else None,
        sigma_s=0.0006 if is_determined else None,
        half_width_95_s=0.0012 if is_determined else None,
        is_determined=is_determined,
        is_kept=is_determined,
        meaning="images are 23.1 ms later than their stamps say"
        if is_determined
        else "not determined: drive at different speeds, with turns",
    )


def with_camera(
    record: CalibrationDocument, given: Camera, found: Camera, **changes: Any
) -> CalibrationDocument:
    """A calibration that found one camera on a drive that has another one."""
    camera = refined_camera(given, found, **changes)
    return record.model_copy(
        update={"camera": camera, "input": record.input.model_copy(update={"camera": given})}
    )


def of_another_drive(calibration: CalibrationDocument) -> CalibrationDocument:
    """The same, made from sweeps of other contents, so that a verification counts."""
    return calibration.model_copy(update={"input": calibration.input.model_copy(update={"sha256": {}})})
