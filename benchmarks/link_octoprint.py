"""Print a file with OctoPrint's own printer class; runs in OctoPrint's own environment.

``link_octoprint.py PORT FILE``; prints one JSON line: seconds, CPU seconds, whether it ended. No
server and no plugins around it: what is measured is its communication alone.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time

from octoprint.plugin import plugin_manager
from octoprint.printer.profile import PrinterProfileManager
from octoprint.settings import settings
from octoprint.util.comm import MachineCom, MachineComPrintCallback

LIMIT_S = 120.0


class Deaf(MachineComPrintCallback):
    """Takes no notice of anything."""

    def __getattr__(self, name: str) -> object:
        return lambda *given, **named: None


def main() -> None:
    port, path = sys.argv[1:3]
    chosen = settings(init=True, basedir=tempfile.mkdtemp())
    chosen.setBoolean(["serial", "exclusive"], False)
    chosen.set(["serial", "additionalPorts"], ["/dev/pts/*"])
    plugin_manager(init=True, plugin_folders=[], plugin_bases=[], plugin_entry_points=[])
    host = MachineCom(
        port, 115200, callbackObject=Deaf(), printerProfileManager=PrinterProfileManager()
    )
    host.start()
    _until(host.isOperational, 30.0)
    host.selectFile(path, False)
    time.sleep(0.5)
    before, begin = _cpu(), time.monotonic()
    host.startPrint()
    _until(host.isPrinting, 5.0)
    _until(lambda: not host.isPrinting(), LIMIT_S)
    seconds, cpu = time.monotonic() - begin, _cpu() - before
    print(
        json.dumps({"seconds": seconds, "cpu_s": cpu, "ended": not host.isPrinting()}), flush=True
    )
    time.sleep(1.0)
    os._exit(0)  # its threads don't end by themselves


def _until(true: object, seconds: float) -> None:
    limit = time.monotonic() + seconds
    while not true() and time.monotonic() < limit:  # type: ignore[operator]
        time.sleep(0.005)


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
