"""The stages of a calibration in order, and a verification, which is built from them."""

from semcal_cli.pipeline.calibration import assess as assess
from semcal_cli.pipeline.calibration import calibrate as calibrate
from semcal_cli.pipeline.calibration import estimate_jointly as estimate_jointly
from semcal_cli.pipeline.calibration import fuse as fuse
from semcal_cli.pipeline.calibration import initialize as initialize
from semcal_cli.pipeline.calibration import make_calibration as make_calibration
from semcal_cli.pipeline.calibration import polish as polish
from semcal_cli.pipeline.calibration import refine as refine
from semcal_cli.pipeline.calibration import refine_and_polish as refine_and_polish
from semcal_cli.pipeline.calibration import repeat as repeat
from semcal_cli.pipeline.calibration import start_at as start_at
