"""direct_visual_lidar_calibration's calib.json: p_lidar = T p_camera, `results.T_lidar_camera` as x y z qx qy qz qw."""

from __future__ import annotations

from semcal_cli.formats.documents import entry_format, under
from semcal_cli.formats.format import Source
from semcal_cli.formats.pose import PLACE, XYZW, Numbers

KEY = "T_lidar_camera"


def _recognises(source: Source) -> bool:
    results = source.mapping.get("results")
    return isinstance(results, dict) and KEY in results


FORMAT = entry_format(
    "direct-visual-lidar",
    f"p_lidar = T p_camera: results.{KEY} of calib.json, x y z qx qy qz qw",
    _recognises,
    under("results"),
    Numbers({KEY: (*PLACE, *XYZW)}),
    maps_camera=True,
    as_json=True,
)
