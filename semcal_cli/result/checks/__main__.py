"""Command that writes the page of all checks into the file that is named: docs/troubleshooting.md."""

import sys
from pathlib import Path

from semcal_cli.result.checks.page import page

(name,) = sys.argv[1:]
Path(name).write_text(page(), encoding="utf-8")
