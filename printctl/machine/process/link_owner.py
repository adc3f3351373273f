"""Track the current user of the station's printer link: a print or the idle standby."""

from __future__ import annotations

from printctl.machine.control.standby import Standby
from printctl.machine.control.streamer import Streamer


class LinkOwner:
    """Written by the thread that owns the port, read by any.

    Attributes
    ----------
    switching : bool
        Whether another one is about to take over.
    closing : bool
        Whether nobody will speak any more.
    """

    def __init__(self) -> None:
        self._standby: Standby | None = None
        self._streamer: Streamer | None = None
        self.switching, self.closing = True, False

    @property
    def standby(self) -> Standby | None:
        """The last standby, or None before the first."""
        return self._standby

    @property
    def streamer(self) -> Streamer | None:
        """The print that goes on, or None."""
        return self._streamer

    @property
    def current(self) -> Standby | Streamer | None:
        """Whoever speaks now."""
        return self._streamer or self._standby

    def switch(self) -> None:
        """Announce that another one takes over."""
        self.switching = True

    def switched(self) -> None:
        """Take notice that nobody else takes over for now."""
        self.switching = False

    def stand_by(self, standby: Standby) -> None:
        """Have the standby speak; a kill finds it from here on."""
        self._standby, self._streamer = standby, None
        self.switching = False

    def begin_print(self, streamer: Streamer) -> None:
        """Have a print speak."""
        self._streamer, self.switching = streamer, False
        if self._standby is not None:
            self._standby.end()

    def end_print(self) -> None:
        """Take notice that the print is over."""
        self._streamer, self.switching = None, False

    def fall_silent(self) -> None:
        """Take notice that the printer can't be spoken to until it is connected again."""
        if self._standby is not None:
            self._standby.end()
        self._streamer = None

    def close(self) -> None:
        """Announce that the station closes."""
        self.closing = True
