"""The numeric core, which is compiled from `rust/`. This is the only module that imports it."""

from importlib.util import find_spec

NO_CORE = (
    "found the sources without their compiled core: leave this folder, so that Python finds the installed package, or "
    "build the core with `pip install -e .`"
)
"""Error of a package that has not been built, such as that of a clone."""

if find_spec("semcal_cli._core") is None:
    raise ImportError(f"{__file__.removesuffix('core.py')}: {NO_CORE}", name="semcal_cli")

from semcal_cli._core import *  # noqa: E402, F403
