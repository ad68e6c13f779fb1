"""Hook of mkdocs that publishes the JSON Schemas at the addresses that they state."""

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

SCHEMAS = Path(__file__).parents[1] / "semcal_cli" / "schemas"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the schemas to what the site consists of."""
    for path in sorted(SCHEMAS.glob("*.schema.json")):
        files.append(File.generated(config, f"schemas/{path.name}", abs_src_path=str(path)))
    return files
