"""The answering side of a process that works on items, until the asking side has gone."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import Any, TextIO


def serve(answers_to: Callable[[Any], Iterator[Any]]) -> None:
    """Answer questions, lines of JSON on standard input, with lines of JSON on standard output; never returns."""
    # The work itself reads empty input, and what it prints does not go to the asking process.
    asked = os.fdopen(os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    answered = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    questions: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(asked, questions), daemon=True).start()
    while True:
        for answer in answers_to(json.loads(questions.get())):
            try:
                answered.write(json.dumps(answer) + "\n")
                answered.flush()
            except BrokenPipeError:
                os._exit(
                    1
                )  # The asking process was killed; the end of the input says the same a moment later.


def _listen(asked: TextIO, questions: SimpleQueue[str]) -> None:
    """Notice the end of the input at once: the asking process has gone then, and needs no answer."""
    for line in asked:
        questions.put(line)
    os._exit(1)
