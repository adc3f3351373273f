"""Acquire one picture: `python -m printctl.observe.devices SETTINGS OUT`; prints its path.

Of a folder the files that were there before are told on standard input. It ends with the process
that started it, and so does the device's own program.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Final

from printctl.observe.devices.camera import take_picture
from printctl.observe.devices.files import (
    await_file,
    keep_file,
    run_command,
    simulated_picture,
)
from printctl.observe.devices.settings import DeviceSettings

_WATCH_S: Final = 0.2


def main() -> int:
    """Acquire; 1 and one line on stderr where it can't."""
    if hasattr(os, "killpg"):  # elsewhere a process isn't told that its parent is gone
        threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    settings, out = DeviceSettings.from_json(sys.argv[1]), Path(sys.argv[2])
    try:
        if settings.kind == "camera":
            picture = take_picture(settings, out)
        elif settings.kind == "folder":
            told = json.load(sys.stdin).items()
            before = {name: (int(at), int(size)) for name, (at, size) in told}
            taken = await_file(Path(settings.source), before, settings.tables)
            picture = keep_file(taken, out)
        elif settings.kind == "command":
            picture = run_command(settings.source, out)
        else:
            picture = simulated_picture(settings, out)
    except (OSError, ValueError) as exc:
        print(" ".join(str(exc).split()), file=sys.stderr)
        return 1
    print(picture)
    return 0


def _end_with(parent: int) -> None:
    """End this process group once its parent is gone: a scan of nobody's would disturb the next."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    if os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
