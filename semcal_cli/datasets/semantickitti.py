"""SemanticKITTI: KITTI odometry with the labels of its points in ROOT/sequences/00/labels (www.semantic-kitti.org).

A label is 32 bits: the class in the lower 16, the instance in the upper 16.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from semcal_cli.datasets import kitti_odometry
from semcal_cli.datasets.files import files_by_stem
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.datasets.recording import Recording, Request, SourceFrame


def read(request: Request) -> Recording:
    """Find the frames of a sequence, with the labels of their points."""
    recording = kitti_odometry.read(request)
    frames = [replace(frame, point_labels=_label(frame)) for frame in recording.frames]
    return replace(recording, frames=frames, point_classes=read_ontology("semantickitti"))


def _label(frame: SourceFrame) -> Path | None:
    assert isinstance(frame.points, Path)
    return files_by_stem(frame.points.parents[1] / "labels", ".label").get(frame.name)
