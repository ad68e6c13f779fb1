"""The stages of a calibration in order, and a verification, which is built from them."""

from semcal_cli.pipeline.calibration import (
    assess as assess,
    calibrate as calibrate,
    cross_validate as cross_validate,
    estimate_jointly as estimate_jointly,
    fuse as fuse,
    initialize as initialize,
    polish as polish,
    refine as refine,
    refine_and_polish as refine_and_polish,
    repeat as repeat,
    start_at as start_at,
)
from semcal_cli.pipeline.conclusion import make_calibration as make_calibration
