"""Entry point of the worker that writes one HTML view: a run's network, its layers, a tissue.

What can't be made is said in the last line of standard error, with exit code 1.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Final

from printctl.failures import message_and_code
from printctl.web.low_priority import lower_priority

_WRITERS: Final = {
    "network": "network_page:write_network",
    "gcode": "gcode_page:write_gcode",
    "tissue": "tissue_page:write_tissue",
}
"""Modules of this package; a page waits for what its own one imports alone."""


def main() -> int:
    """Make one page."""
    lower_priority()
    sort, run, page = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    module, _, writer = _WRITERS[sort].partition(":")
    try:
        getattr(import_module(f"{__package__}.{module}"), writer)(run, page)
    except Exception as exc:
        known = message_and_code(exc)
        if known is None:
            raise
        print(" ".join(known[0].split()), file=sys.stderr)
        return 1
    return 0
