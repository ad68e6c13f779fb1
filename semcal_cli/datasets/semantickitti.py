"""SemanticKITTI: KITTI odometry with point labels in ROOT/sequences/00/labels (www.semantic-kitti.org).

A label has 32 bits: the class in the lower 16, the instance in the upper 16.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from semcal_cli.datasets import kitti_odometry
from semcal_cli.datasets.files import files_by_stem
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.datasets.recording import Recording, Request


def read(request: Request) -> Recording:
    """Find the frames of a sequence, with the labels of their points.

    Raises:
        InputError: the sequence, the camera or a file is missing or wrong, or no frame is complete.
    """
    recording = kitti_odometry.read(request)
    first = recording.frames[0].points
    assert isinstance(first, Path)
    labels = files_by_stem(first.parents[1] / "labels", ".label")
    frames = [replace(frame, point_labels=labels.get(frame.name)) for frame in recording.frames]
    return replace(recording, frames=frames, point_classes=read_ontology("semantickitti"))
