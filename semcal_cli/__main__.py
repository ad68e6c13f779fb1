"""The command `semcal`, which is also `python -m semcal_cli`."""

import gc
import os
import signal

GARBAGE_AFTER = 200_000
"""Number of new objects after which Python collects garbage, instead of a few hundred or thousand: imports create half
as many, and no garbage. It holds for the whole run, because each command imports its modules when it is called."""


def main() -> None:
    """Run the command line. While it is being loaded, Ctrl-C ends it silently."""
    gc.set_threshold(GARBAGE_AFTER)
    # When the first model is made, pydantic would look for plugins in the metadata of every installed package: 16 ms.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    is_heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_heard:
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    from semcal_cli.cli import main as run

    if is_heard:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
