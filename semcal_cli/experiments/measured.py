"""Where and when figures were measured: the machine, the date and the commit."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from datetime import date
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The clone, if semcal is installed from one in place."""


def machine() -> dict[str, object]:
    """Describe this machine."""
    cpuinfo = Path("/proc/cpuinfo")
    names = re.findall(
        r"^model name\s*:\s*(.+)$", cpuinfo.read_text() if cpuinfo.exists() else "", re.MULTILINE
    )
    return {
        "semcal": version("semcal"),
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
    }


@cache
def measured_here() -> str:
    """Describe where and when this process runs: the machine, the date and the commit."""
    description = machine()
    files = sorted(Path("/proc/driver/nvidia/gpus").glob("*/information"))
    models = [re.search(r"^Model:\s*(.+)", file.read_text(), re.MULTILINE) for file in files]
    gpu = " and ".join(model[1] for model in models if model) or "no NVIDIA GPU"
    cores = f"{description['cores']} core{'s' * (description['cores'] != 1)}"
    return f"{description['processor']}, {cores}, {gpu}, {date.today()}, {commit()}"


def commit() -> str:
    """Name the clone's commit and whether files other than pages have changes; without a clone, the version."""
    git = partial(subprocess.check_output, stderr=subprocess.DEVNULL, text=True, cwd=ROOT)
    try:
        if not (ROOT / ".git").exists():
            return f"semcal {version('semcal')}"
        head = git(["git", "rev-parse", "--short", "HEAD"])
        changes = git(["git", "status", "--porcelain", "-uno", "--", ".", ":!*.md"])
    except (OSError, subprocess.CalledProcessError):
        return f"semcal {version('semcal')}"
    return f"commit {head.strip()}{' and changes' if changes else ''}"
