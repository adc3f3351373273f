"""Acquire one picture: `python -m printctl.observe.devices SETTINGS OUT SINCE`; prints its path."""

from __future__ import annotations

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
    settings, out, since = DeviceSettings.from_json(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    try:
        if settings.kind == "camera":
            picture = take_picture(settings, out)
        elif settings.kind == "folder":
            picture = keep_file(await_file(Path(settings.source), float(since)), out)
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
