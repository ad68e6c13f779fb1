"""Addresses in the documentation: the entry of each finding, and the JSON Schema of each document.

`pyproject.toml` and `mkdocs.yml` contain the same address.
"""

ADDRESS = "https://semcal.readthedocs.io"
"""Address of the site that is built from the folder `docs`."""
WITH_SCHEMA = (
    *("semcal_drive", "semcal_rig", "semcal_calibration", "semcal_rig_calibration"),
    *("semcal_image_model", "semcal_point_model"),
)
"""First keys of the documents that have a JSON Schema; their values are the versions."""


def entry_address(topic: str) -> str:
    """Return the address of the entry that explains a finding.

    Args:
        topic: `Finding.topic`, the anchor of the entry in docs/troubleshooting.md.
    """
    return f"{ADDRESS}/troubleshooting/#{topic}"


def schema_name(key: str, version: int) -> str:
    """Name the JSON Schema file of a document that begins with this key and version."""
    return f"{key}-{version}.schema.json"


def schema_address(key: str, version: int) -> str:
    """Return the address of the JSON Schema of a document, which is also its `$id`."""
    return f"{ADDRESS}/schemas/{schema_name(key, version)}"
