"""The process that does items: it answers questions until whoever asks has gone."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import Any, TextIO


def serve(answers_to: Callable[[Any], Iterator[Any]]) -> None:
    """Answer questions, lines of JSON on standard input, by such lines on standard output; never returns."""
    # What the work itself reads is empty, and what it prints is not for whoever asks.
    asked = os.fdopen(os.dup(0))
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    answered = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    questions: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(asked, questions), daemon=True).start()
    while True:
        for answer in answers_to(json.loads(questions.get())):
            answered.write(json.dumps(answer) + "\n")
            answered.flush()


def _listen(asked: TextIO, questions: SimpleQueue[str]) -> None:
    """Hear the end of the input at once: whoever asks has gone, and wants no answer any more."""
    for line in asked:
        questions.put(line)
    os._exit(1)
