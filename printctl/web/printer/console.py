"""Console of the Printer page: send a user's typed command, keep replies and refusals for all."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

from printctl.machine.link.errors import LinkError
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, WebError
from printctl.web.printer.printer_access import PrinterAccess

KEPT: Final = 500
LONGEST: Final = 200


@dataclass(frozen=True)
class Entry:
    """Entry of the console.

    Attributes
    ----------
    number : int
        Counts up.
    at_s : float, s since 1970
    who, text : str
    replies : tuple of str
    refused : str
        Why it wasn't sent, or failed; empty when it went out.
    """

    number: int
    at_s: float
    who: str
    text: str
    replies: tuple[str, ...] = ()
    refused: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


class Console:
    """Sends lines and keeps what came of them, the same for all browsers.

    Parameters
    ----------
    access : PrinterAccess
    clock : function
        Seconds since 1970.
    """

    def __init__(self, access: PrinterAccess, clock: Callable[[], float] = time.time) -> None:
        self._access, self._clock = access, clock
        self._entries: deque[Entry] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = threading.Lock()

    def entries(self, after: int = 0) -> list[Entry]:
        """Those with a number above ``after``, oldest first."""
        with self._lock:
            return [entry for entry in self._entries if entry.number > after]

    def send(self, who: Principal, typed: str) -> list[str]:
        """Send a line; give the reply.

        Raises
        ------
        BadRequestError
            For no line, or more than one.
        NotInControlError, ConflictError, LinkError
        """
        text = checked_line(typed)
        try:
            replies = self._access.ask(who).command(text)
        except (LinkError, WebError) as exc:
            self._keep(who, text, refused=str(exc))
            raise
        self._keep(who, text, tuple(replies))
        return replies

    def _keep(
        self, who: Principal, text: str, replies: tuple[str, ...] = (), refused: str = ""
    ) -> None:
        with self._lock:
            self._count += 1
            entry = Entry(self._count, self._clock(), who.name, text, replies, refused)
            self._entries.append(entry)
        self._access.core.events.publish("console", **entry.to_dict())


def checked_line(typed: str) -> str:
    """One command as it can be sent.

    Raises
    ------
    BadRequestError
    """
    text = typed.strip()
    if not text or len(text) > LONGEST or not (text.isascii() and text.isprintable()):
        raise BadRequestError(
            f"{typed[:40]!r} isn't one command: 1 to {LONGEST} printable ASCII characters on one "
            "line"
        )
    return text
