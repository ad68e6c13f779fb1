"""The threads of the Rust stages."""

from __future__ import annotations

from semcal_cli import _core


def set_num_threads(num_threads: int | None) -> None:
    """Run the Rust stages on so many threads; on as many as the process may use if None."""
    if num_threads is not None:
        _core.set_num_threads(num_threads)
