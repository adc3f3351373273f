"""Entry point of the simulated printer (``python -m sim``) and devices over its dish."""

from __future__ import annotations

import sys
from typing import Final

_DEVICES: Final = ("camera", "oct", "laser_line")
"""As of `sim.looks`, which needs OpenCV."""


def main(arguments: list[str] | None = None) -> int:
    """Serve until stopped by a signal; 0 when that went well, 1 when not, 2 for a wrong use."""
    words = sys.argv[1:] if arguments is None else arguments
    # A printer's process does without OpenCV, and starts the sooner.
    if words and words[0] in _DEVICES:
        from sim.looks import main as look

        return look(words)
    from sim.devices.serving.command import serve_printer

    return serve_printer(words)


if __name__ == "__main__":
    sys.exit(main())
