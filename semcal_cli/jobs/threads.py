"""The threads of the Rust stages."""

from __future__ import annotations

from semcal_cli import _core


def set_num_threads(num_threads: int | None) -> None:
    """Run the Rust stages on this number of threads; None takes all that the process may use."""
    if num_threads is not None:
        _core.set_num_threads(num_threads)
