"""The file that my robot keeps its mounting in."""

from semcal_cli.formats.document_formats import entry_format, under
from semcal_cli.formats.pose import WXYZ, XYZ, NumbersNotation

FORMAT = entry_format(
    "my-robot",
    "p_lidar = T p_camera: mounting.q (w x y z) and mounting.t",
    lambda source: "mounting" in source.mapping,
    under("mounting"),
    NumbersNotation({"q": WXYZ, "t": XYZ}),
    maps_camera=True,
)
