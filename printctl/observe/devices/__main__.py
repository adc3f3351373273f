"""Acquire one picture: `python -m printctl.observe.devices SETTINGS OUT`; prints its path.

Of a folder the files that were there before are told on standard input.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from printctl.observe.devices.camera import take_picture
from printctl.observe.devices.files import (
    await_file,
    keep_file,
    run_command,
    simulated_picture,
)
from printctl.observe.devices.settings import DeviceSettings


def main() -> int:
    """Acquire; 1 and one line on stderr where it can't."""
    settings, out = DeviceSettings.from_json(sys.argv[1]), Path(sys.argv[2])
    try:
        if settings.kind == "camera":
            picture = take_picture(settings, out)
        elif settings.kind == "folder":
            told = json.load(sys.stdin).items()
            before = {name: (int(at), int(size)) for name, (at, size) in told}
            picture = keep_file(await_file(Path(settings.source), before), out)
        elif settings.kind == "command":
            picture = run_command(settings.source, out)
        else:
            picture = simulated_picture(settings, out)
    except (OSError, ValueError) as exc:
        print(" ".join(str(exc).split()), file=sys.stderr)
        return 1
    print(picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
