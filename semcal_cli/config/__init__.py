"""Every default, once.

Nothing heavy is imported here, so that `semcal --help` can show them at once. A stage takes its settings as one of
these classes, and the Rust core reads the attributes of the same objects. The settings that change an answer are
recorded in the result under `settings.options`.
"""

from semcal_cli.config.calibration import CalibrationConfig as CalibrationConfig
from semcal_cli.config.calibration import Limits as Limits
from semcal_cli.config.constants import AUTO as AUTO
from semcal_cli.config.constants import EDGE_BAND_PX as EDGE_BAND_PX
from semcal_cli.config.constants import FAR_DEG as FAR_DEG
from semcal_cli.config.constants import LABELS as LABELS
from semcal_cli.config.constants import MAX_BASELINE_M as MAX_BASELINE_M
from semcal_cli.config.constants import MAX_FRAMES as MAX_FRAMES
from semcal_cli.config.constants import MAX_POINTS as MAX_POINTS
from semcal_cli.config.constants import MIN_OVERLAP as MIN_OVERLAP
from semcal_cli.config.constants import CueName as CueName
from semcal_cli.config.constants import Device as Device
from semcal_cli.config.constants import Estimator as Estimator
from semcal_cli.config.constants import Zoom as Zoom
from semcal_cli.config.initialization import AlignmentConfig as AlignmentConfig
from semcal_cli.config.initialization import InitializationConfig as InitializationConfig
from semcal_cli.config.initialization import PnpConfig as PnpConfig
from semcal_cli.config.refinement import CENTER_SIGMA_PX as CENTER_SIGMA_PX
from semcal_cli.config.refinement import FOCAL_SIGMA as FOCAL_SIGMA
from semcal_cli.config.refinement import ExactConfig as ExactConfig
from semcal_cli.config.refinement import JointConfig as JointConfig
from semcal_cli.config.refinement import JointlyConfig as JointlyConfig
from semcal_cli.config.refinement import PolishConfig as PolishConfig
from semcal_cli.config.refinement import PyramidConfig as PyramidConfig
from semcal_cli.config.refinement import RefinementConfig as RefinementConfig
from semcal_cli.config.refinement import SensitivityConfig as SensitivityConfig
from semcal_cli.config.refinement import StartsConfig as StartsConfig
from semcal_cli.config.setting import MAX_SEED as MAX_SEED
from semcal_cli.config.synthetic import ReadoutDirection as ReadoutDirection
from semcal_cli.config.synthetic import SynthConfig as SynthConfig
