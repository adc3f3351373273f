"""Read lines inserted into a job, from the print host's journal.

The format is `printctl.machine.link.journal`'s, written down here once more, because a simulated
printer imports nothing of its host: ``<crc32 of the JSON, 8 hex digits> <JSON>`` a line, records
with ``t: insert``, ``after`` (commands of the job before, earlier inserts counted), ``lines`` and
perhaps ``flow``: what writes behind it pushes so many times what the file says.
"""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import NamedTuple


class Inserted(NamedTuple):
    """Commands before an insert, its lines, and the flow behind it."""

    after: int
    lines: list[bytes]
    flow: float


def inserted_lines(journal: Path) -> list[Inserted]:
    """Return what was inserted, in order.

    Records of a print before the last one that began anew aren't told apart: the host keeps one
    print in a journal. A line that is torn or damaged is passed over.
    """
    inserted: list[Inserted] = []
    try:
        text = journal.read_bytes()
    except OSError:
        return inserted
    for line in text.splitlines():
        crc, _, record = line.partition(b" ")
        if b'"insert"' not in record or crc != b"%08x" % zlib.crc32(record):
            continue
        entry = json.loads(record)
        if entry.get("t") == "insert":
            lines = [str(one).encode() for one in entry["lines"]]
            inserted.append(Inserted(int(entry["after"]), lines, float(entry.get("flow", 1.0))))
    return inserted
