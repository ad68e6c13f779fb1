"""The process that runs the cases of an experiment: see `semcal_cli.experiments.runner`."""

from __future__ import annotations

import pickle
import traceback
from base64 import b64decode, b64encode
from collections.abc import Iterator
from typing import Any

from semcal_cli.errors import SemcalError
from semcal_cli.jobs.serving import serve
from semcal_cli.threads import set_num_threads


def main() -> None:
    """Run cases until there are no more."""
    serve(_run)


def pack(value: object) -> str:
    """Pickle an object as text for the other process."""
    return b64encode(pickle.dumps(value)).decode()


def unpack(text: str) -> Any:
    """Restore an object that the other process packed."""
    return pickle.loads(b64decode(text))


def _run(question: dict[str, Any]) -> Iterator[str]:
    """Yield the results of a case, or the exception that ended it."""
    run, case = unpack(question["work"])
    set_num_threads(question["num_threads"])
    try:
        answer = run(case)
    except BaseException as failure:
        if not isinstance(failure, SemcalError):
            traceback.print_exc()
        answer = failure
    yield pack(answer)
