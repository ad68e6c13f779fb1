"""The limits that the documentation states are those of the code."""

import re
from pathlib import Path

from semcal_cli.batch import records
from semcal_cli.config import MAX_POINTS
from semcal_cli.datasets import ply
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.experiments import journal
from semcal_cli.files import picture_sizes, point_clouds, reading, rows, yaml_values
from semcal_cli.formats import format
from semcal_cli.geometry import poses

DOCS = Path(__file__).parents[1] / "docs"
LIMITS = {
    reading.MAX_DOCUMENT_BYTES: "bytes",
    reading.MAX_TABLE_BYTES: "bytes",
    records.MAX_RECORD_BYTES: "bytes",
    journal.MAX_BYTES: "bytes",
    ply.MAX_BYTES: "bytes",
    rows.MAX_ROWS_BYTES: "bytes",
    rows.MAX_ROW: "characters a row",
    format.MAX_YAML_BYTES: "bytes",
    yaml_values.MAX_VALUES: "values",
    yaml_values.MAX_DEPTH: "levels",
    MAX_POINTS: "points a sweep",
    point_clouds.BYTES_A_POINT: "bytes a point",
    picture_sizes.MAX_PIXELS: "pixels",
}


def test_limits_are_those_of_the_code() -> None:
    text = (DOCS / "input.md").read_text()
    stated = {
        (int(number.replace(",", "")), unit)
        for number, unit in re.findall(
            r"([\d,]*\d) (bytes a point|bytes|characters a row|values|levels|points a sweep|pixels)\b", text
        )
    }
    assert stated == set(LIMITS.items())
    assert f"off by {poses.RIGID_TOLERANCE:g}" in text


def test_the_files_of_class_names_are_read(tmp_path: Path) -> None:
    section = (DOCS / "labels.md").read_text().partition("## Names of classes")[2].partition("\n## ")[0]
    blocks = re.findall(r"```yaml\n(.*?)```", section, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        (tmp_path / "classes.yaml").write_text(block)
        assert read_ontology(str(tmp_path / "classes.yaml")).ids() == {"road": [7], "car": [26, 27]}
