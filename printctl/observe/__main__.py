"""Start an observer: ``python -m printctl.observe FOLDER [--detach]``."""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from pathlib import Path

from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.launch import detach
from printctl.observe.process import observe
from printctl.observe.records import LOG_FILE
from printctl.processes.alive import ignore_signals


def main() -> int:
    """Observe a print to its end; return 1 if none begins or it can't be observed."""
    parser = argparse.ArgumentParser(prog="python -m printctl.observe")
    parser.add_argument("folder", type=Path, help="folder of the print")
    parser.add_argument("--detach", action="store_true", help="run in the background")
    arguments = parser.parse_args()
    if arguments.detach:
        detach(arguments.folder / LOG_FILE, "printctl.observe")
    ignore_signals()
    signal.signal(signal.SIGTERM, _leave)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    try:
        observe(arguments.folder)
    except (PrintctlError, LinkError, OSError, ValueError) as exc:
        # The starter reports the log's last line.
        print(" ".join(str(exc).split()), file=sys.stderr)
        return 1
    return 0


def _leave(*_: object) -> None:
    """Exit through `sys.exit`, so that started subprocesses are ended, too."""
    sys.exit(1)


if __name__ == "__main__":
    sys.exit(main())
