"""Libraries that only some commands need: pip installs them with an extra of semcal."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec

from semcal_cli.errors import InputError


def is_installed(package: str) -> bool:
    """Tell whether a library is there, without importing it."""
    with suppress(ImportError):
        return find_spec(package) is not None
    return False


def described(extra: str) -> str:
    """Name an extra, with the commands that install it."""
    return f"the extra '{extra}': pip install 'semcal[{extra}]', in a clone: pip install '.[{extra}]'"


def check_installed(asked: str, package: str, extra: str) -> None:
    """Check that a library is there, before anything is read.

    Args:
        asked: The option, file or command that needs it.
        package: Name by which it is imported.
        extra: Name of semcal's extra with it.

    Raises:
        InputError: it is not installed.
    """
    if not is_installed(package):
        raise InputError(f"{asked}: found no {package}, needed {described(extra)}")


def check_torch(asked: str) -> None:
    """Check that torch is there, for MINE.

    Raises:
        InputError: it is not installed.
    """
    check_installed(asked, "torch", "mine")


@contextmanager
def torch_import() -> Iterator[None]:
    """Import what imports torch, and let Python not look for garbage meanwhile: what torch brings stays.

    Raises:
        InputError: torch is there, but cannot be imported, as without a library of the system.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    except (ImportError, OSError) as error:
        found = " ".join(str(error).split())
        raise InputError(
            f"torch: found one that cannot be imported ({found}), needed {described('mine')}"
        ) from None
    finally:
        if was_enabled:
            gc.enable()
