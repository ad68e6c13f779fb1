"""The networks that made the labels of a drive, as its drive.yaml and a result name them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from semcal_cli.files.validation import StrictModel

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class LabelNetwork(StrictModel):
    """A network that made labels."""

    name: Annotated[str, Field(min_length=1)]
    """Name on the hub with the commit and the file, hf:OWNER/NAME@COMMIT:FILE, or the name of its file."""
    sha256: dict[str, str]
    """SHA-256 of the model, and of the files of its weights by their names."""
    licence: str | None = None
    """Licence of its weights, if its card or the list of short names states one."""


class LabelNetworks(StrictModel):
    """Networks that made the labels of each side; a side without one was labelled otherwise."""

    image: LabelNetwork | None = None
    """The network of the label images."""
    points: LabelNetwork | None = None
    """The network of the labels of points."""
