"""The stages of a calibration, and the whole of it. `pipeline.verification` is built from them, too."""

from semcal_cli.pipeline.assessment import assess as assess
from semcal_cli.pipeline.calibration import (
    calibrate as calibrate,
    cross_validate as cross_validate,
    repeat as repeat,
)
from semcal_cli.pipeline.conclusion import make_calibration as make_calibration
from semcal_cli.pipeline.pose_stages import (
    estimate_jointly as estimate_jointly,
    fuse as fuse,
    initialize as initialize,
    polish as polish,
    refine as refine,
    refine_and_polish as refine_and_polish,
    start_at as start_at,
)
