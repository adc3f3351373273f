"""A serial line between host and board that can be dead for a time: two pseudo-terminals."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty
from pathlib import Path
from types import TracebackType

POLL_S = 0.005


class HeldLine:
    """Passes bytes on, both ways; while it is held it keeps them. Use it as a context manager.

    Parameters
    ----------
    board : Path
        The board's port.
    port : Path
        Where the host finds the line: a link to a pseudo-terminal.
    """

    def __init__(self, board: Path, port: Path) -> None:
        self.port, self._board_path = port, board
        self._held, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._pass_on, daemon=True)

    def __enter__(self) -> HeldLine:
        """Open both ends."""
        self._host, inside = os.openpty()
        tty.setraw(inside)
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(os.ttyname(inside))
        os.close(inside)  # whoever has it open is a second program
        self._board = os.open(self._board_path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._board)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close both ends."""
        self._over.set()
        self._thread.join(5.0)
        os.close(self._host)
        os.close(self._board)
        self.port.unlink(missing_ok=True)

    def hold(self) -> None:
        """Keep what comes from now on."""
        self._held.set()

    def release(self) -> None:
        """Pass on what was kept, and what comes."""
        self._held.clear()

    def _pass_on(self) -> None:
        kept = {self._host: b"", self._board: b""}
        while not self._over.is_set():
            for end in select.select([*kept], [], [], POLL_S)[0]:
                with contextlib.suppress(OSError):  # EIO: the host hasn't opened it
                    kept[end] += os.read(end, 65536)
            if self._held.is_set():
                continue
            for end, other in ((self._host, self._board), (self._board, self._host)):
                if kept[end]:
                    kept[end] = kept[end][os.write(other, kept[end]) :]
