"""Independent streams of random numbers of a synthetic drive."""

import numpy as np

from semcal_cli.config.synthetic import SynthConfig

MOUNTING, ONTOLOGY, POINT_LABELS, IMAGE_LABELS, MOTION = range(5)


def generator(config: SynthConfig, stream: int, frame: int = 0, *more: int) -> np.random.Generator:
    """Make the generator of one stream, of a frame and of whatever else tells it apart."""
    return np.random.default_rng((config.seed, stream, frame, *more))
