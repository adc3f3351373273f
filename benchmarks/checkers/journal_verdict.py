"""Read a print's journal and state what it must report of the print. No product code."""

from __future__ import annotations

import json
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Written:
    """What a journal says.

    Attributes
    ----------
    state : str
        Last one recorded; empty for a journal without any.
    ended : bool
        Whether the end is written down.
    begun : bool
        Whether lines of the job may have been sent.
    stopping : bool
        Whether a controlled stop had begun.
    done : int
        Lines known to be taken.
    pid : int
        The process that wrote it; 0 when that isn't there.
    torn : int
        Lines that can't be read.
    """

    state: str = ""
    ended: bool = False
    begun: bool = False
    stopping: bool = False
    done: int = 0
    pid: int = 0
    torn: int = 0

    @property
    def true_state(self) -> str:
        """What must be told: without an end, and with its writer dead, it is an interruption."""
        if self.ended or not self.pid or lives(self.pid):
            return self.state
        return "interrupted"

    @property
    def resumable(self) -> bool:
        """Whether a print whose process died can be gone on with, as far as a journal can tell."""
        return self.begun and not self.ended and not self.stopping


def read_written(path: Path) -> Written:
    """Read a journal; one that isn't there says nothing."""
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
    except FileNotFoundError:
        return Written()
    told: dict[str, Any] = {}
    torn = 0
    for line in lines:
        crc, _, text = line.partition(b" ")
        if crc != b"%08x" % zlib.crc32(text):
            torn += 1
            continue
        told |= _record(json.loads(text))
    return Written(**told, torn=torn)


def _record(record: dict[str, Any]) -> dict[str, Any]:
    kind = record["t"]
    if kind == "job":
        return {"pid": record["pid"], "ended": False}
    if kind == "state":
        state = record["state"]
        found: dict[str, Any] = {"state": state}
        found |= {"begun": True} if state == "printing" else {}
        return found | ({"stopping": True} if state == "stopping" else {})
    if kind in ("ack", "back"):
        return {"done": record["done"]}
    if kind == "end":
        return {"state": record["state"], "ended": True, "done": record["done"]}
    return {}


def lives(pid: int) -> bool:
    """Whether a process runs; one that has ended and wasn't waited for doesn't."""
    try:
        os.kill(pid, 0)
        text = Path(f"/proc/{pid}/stat").read_text()
    except (ProcessLookupError, FileNotFoundError):
        return False
    return text.rpartition(")")[2].split()[0] != "Z"
