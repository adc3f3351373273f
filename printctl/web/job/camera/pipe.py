"""Message format of the camera process: a line of JSON, then a picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import IO, Final

_LONGEST_LINE: Final = 2000
_MOST_BYTES: Final = 20_000_000


@dataclass(frozen=True)
class Message:
    """One word from the camera.

    Attributes
    ----------
    problem : str
        Why there is no picture; empty when there is one.
    jpeg : bytes
    """

    problem: str = ""
    jpeg: bytes = b""


def write_message(out: IO[bytes], message: Message) -> None:
    """Write it, whole."""
    head = {"problem": message.problem, "size": len(message.jpeg)}
    out.write(json.dumps(head).encode() + b"\n" + message.jpeg)
    out.flush()


def read_message(source: IO[bytes]) -> Message | None:
    """Read one; None at the end, or where what comes is none."""
    try:
        head = json.loads(source.readline(_LONGEST_LINE))
        size = int(head["size"])
        if not 0 <= size <= _MOST_BYTES:
            return None
        jpeg = source.read(size)
        return Message(str(head["problem"]), jpeg) if len(jpeg) == size else None
    except (ValueError, KeyError, TypeError, OSError):
        return None
