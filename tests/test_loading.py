"""A drive and what was read of it go together, frame by frame."""

import math
from hashlib import sha256
from pathlib import Path

import pytest

from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.cue_table import files_of
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import make_calibration, start_at
from semcal_cli.pipeline.stages import Stages
from semcal_cli.result.provenance import with_provenance

CHOSEN = [3, 1]


@pytest.mark.parametrize("cues", [("labels",), ("intensity",), ("labels", "intensity")])
def test_a_calibration_of_some_frames_records_these(
    street: Path, street_truth: Pose, cues: tuple[CueName, ...]
) -> None:
    config = CalibrationConfig(cues=cues)
    data = load(street, config)
    few = data.of_frames(CHOSEN)
    calibration = make_calibration(
        few, Stages(start_at(few, InitialPose(street_truth, "truth")), max_baseline_m=math.inf), config
    )
    assert calibration.input.sha256 == {}
    calibration = with_provenance(calibration, few)
    assert calibration.quality.num_frames == len(CHOSEN)
    frames = [data.drive.frames[index] for index in CHOSEN]
    assert [frame.points for frame in calibration.input.frames] == [frame.points for frame in frames]
    names = set(filter(None, (getattr(frame, key) for frame in frames for key in files_of(cues))))
    hashes = {name: sha256((street / name).read_bytes()).hexdigest() for name in {"drive.yaml"} | names}
    assert calibration.input.sha256 == hashes
    assert any("image_labels" in name for name in hashes) == ("labels" in cues)
