"""The networks that made the labels of a drive, as recorded in its drive.yaml and in results."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from semcal_cli.files.validation import FileName, Share, StrictModel


class LabelNetwork(StrictModel):
    """A network that made labels."""

    name: Annotated[str, Field(min_length=1)]
    """Name on the hub with the commit and the file, hf:OWNER/NAME@COMMIT:FILE, or the file name of the model."""
    sha256: dict[str, str]
    """SHA-256 of the model, under model, and of its weight files, by name."""
    licence: str | None = None
    """Licence of the weights, if the card or the list of short names states one."""


class SecondLabels(StrictModel):
    """Image labels of a second network, in a drive of their own."""

    drive: FileName
    """The drive.yaml with these labels, relative to that with the labels of the first network."""
    disagreement: Share | None = None
    """Share of pixels to which the two give different classes; absent if no pixel has a class from both."""

    @property
    def sentence(self) -> str:
        """Sentence about how far the two networks differ."""
        if self.disagreement is None:
            return f"the second network ({self.drive}) labels none of the pixels that the first labels"
        return f"the second network ({self.drive}) differs in {self.disagreement:.1%} of the pixels"


class LabelNetworks(StrictModel):
    """Networks that made the labels of each side. A side without one was labelled in another way."""

    image: LabelNetwork | None = None
    """Network of the image labels."""
    points: LabelNetwork | None = None
    """Network of the point labels."""
    second: SecondLabels | None = None
    """Image labels of a second network."""

    def describe(self) -> list[str]:
        """Name the networks, one per line, and say how far two of them differ."""
        lines = [
            f"{side} labels: {network.name}{'' if network.licence is None else f', {network.licence}'}"
            for side, network in (("image", self.image), ("point", self.points))
            if network is not None
        ]
        if self.second is not None:
            lines.append(self.second.sentence)
        return lines
