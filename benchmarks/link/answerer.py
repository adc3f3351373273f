"""Minimal peer behind a pseudo-terminal: acknowledges every line at once and records it.

``python -m benchmarks.link.answerer RECORD``: prints the port's name; ends after M400, or when
its input is closed. It has a printer's numbering, no motion, and imports nothing of the product.
"""

from __future__ import annotations

import json
import os
import re
import select
import sys
import time
import tty
from dataclasses import dataclass, field
from pathlib import Path

ANSWERS = {
    b"M105": b"ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0\n",
    b"M115": b"FIRMWARE_NAME:Marlin 2.1.2 SOURCE_CODE_URL:x\nCap:EMERGENCY_PARSER:1\nok\n",
    b"M113": b"echo:M113 S1\nok\n",
    b"M92": b"  M92 X80.00 Y80.00 Z400.00 E6400.00\nok\n",
    b"M114": b"X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\n",
}
_NUMBERS = re.compile(rb"N(-?\d+)")
_COMMAND = re.compile(rb"(?:N(-?\d+) ?)?([A-Z]\d+)?")


@dataclass
class Answerer:
    """A printer without motors; ``lines`` were taken, when, in order."""

    lines: list[tuple[float, bytes]] = field(default_factory=list)
    last: int = 0
    _rest: bytes = b""

    def receive(self, data: bytes) -> bytes:
        """Answer what is complete."""
        *texts, self._rest = (self._rest + data).split(b"\n")
        now = time.monotonic()
        return b"".join([self._take(text, now) for text in texts if text.strip()])

    def _take(self, text: bytes, now: float) -> bytes:
        if text.startswith(b"N%d G1 " % (self.last + 1)):  # nearly every line of a print
            self.last += 1
            self.lines.append((now, text))
            return b"ok\n"
        found = _COMMAND.match(text)
        number, word = (found[1], found[2]) if found else (None, None)
        if b"M110" in text:
            self.last = int(_NUMBERS.findall(text)[-1])  # printcore has it in front only
        elif number is not None and int(number) != self.last + 1:
            said = b"Error:Line Number is not Last Line Number+1, Last Line: %d\nResend: %d\nok\n"
            return said % (self.last, self.last + 1)
        elif number is not None:
            self.last += 1
        self.lines.append((now, text))
        if word in (b"M118", b"M0118"):  # what stands behind E1 is said back
            return b"echo:%b\nok\n" % text.partition(b" E1 ")[2].partition(b"*")[0]
        return ANSWERS.get(word or b"", b"ok\n")


def serve(record: Path) -> None:
    """Answer until the input is closed, then write the record."""
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    peer = Answerer()
    while True:
        ready, _, _ = select.select([master, sys.stdin], [], [])
        if sys.stdin in ready:
            break
        said = peer.receive(os.read(master, 65536))
        while said:
            said = said[os.write(master, said) :]
    taken = [[when, text.decode("latin-1")] for when, text in peer.lines]
    record.write_text(json.dumps(taken))


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
