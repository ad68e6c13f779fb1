"""The networks that made the labels of a drive, as its drive.yaml and a result name them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from semcal_cli.files.validation import FileName, Share, StrictModel


class LabelNetwork(StrictModel):
    """A network that made labels."""

    name: Annotated[str, Field(min_length=1)]
    """Name on the hub with the commit and the file, hf:OWNER/NAME@COMMIT:FILE, or the name of its file."""
    sha256: dict[str, str]
    """SHA-256 of the model, and of the files of its weights by their names."""
    licence: str | None = None
    """Licence of its weights, if its card or the list of short names states one."""


class SecondLabels(StrictModel):
    """Label images of a second network, in a drive of their own."""

    drive: FileName
    """The drive.yaml with them, relative to that with those of the first."""
    disagreement: Share | None = None
    """Share of pixels to which the two give different classes; absent if no pixel has a class of both."""

    @property
    def sentence(self) -> str:
        """Sentence about how far the two networks differ."""
        if self.disagreement is None:
            return f"the second network ({self.drive}) labels no pixel that the first labels"
        return f"the second network ({self.drive}) differs in {self.disagreement:.1%} of the pixels"


class LabelNetworks(StrictModel):
    """Networks that made the labels of each side; a side without one was labelled otherwise."""

    image: LabelNetwork | None = None
    """The network of the label images."""
    points: LabelNetwork | None = None
    """The network of the point labels."""
    second: SecondLabels | None = None
    """Label images of a second network beside those of the first."""

    def describe(self) -> list[str]:
        """Name the networks, one a line, and how far two differ."""
        lines = [
            f"of {side}: {network.name}{'' if network.licence is None else f', {network.licence}'}"
            for side, network in (("pixels", self.image), ("points", self.points))
            if network is not None
        ]
        if self.second is not None:
            lines.append(self.second.sentence)
        return lines
