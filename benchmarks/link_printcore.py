"""Print a file with printrun's printcore; runs in printrun's own environment.

``link_printcore.py PORT FILE``; prints one JSON line: seconds, CPU seconds, whether it ended.
"""

from __future__ import annotations

import json
import resource
import sys
import time

from printrun import gcoder
from printrun.printcore import printcore

LIMIT_S = 120.0


def main() -> None:
    port, path = sys.argv[1:3]
    lines = open(path).read().splitlines()  # noqa: SIM115
    core = printcore(port, 115200)
    limit = time.monotonic() + 20
    while not core.online and time.monotonic() < limit:
        time.sleep(0.05)
    parsed = gcoder.LightGCode(lines)
    before, begin = _cpu(), time.monotonic()
    core.startprint(parsed)
    while core.printing and time.monotonic() < begin + LIMIT_S:
        time.sleep(0.005)
    seconds, cpu = time.monotonic() - begin, _cpu() - before
    ended = not core.printing
    core.send_now("M400")
    time.sleep(1.0)
    core.disconnect()
    print(json.dumps({"seconds": seconds, "cpu_s": cpu, "online": limit > 0, "ended": ended}))


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
