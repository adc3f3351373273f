"""Control lock: one browser at a time may command the printer.

Looking is free, and so are the stops: whoever sees something wrong mustn't have to ask.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from printctl.web.errors import NotInControlError

LEASE_S: Final = 30.0
"""So long the controls stay with a browser that isn't heard of any more."""


@dataclass(frozen=True)
class Principal:
    """Who sends a request: a browser's session or a script, and its name for other people.

    ``user`` is the name given at log-in; empty for none.
    """

    id: str
    name: str = ""
    user: str = ""

    @property
    def by(self) -> str:
        """Who is written down: the name, else the id."""
        return self.name or self.id

    @property
    def actor(self) -> dict[str, str]:
        """As journals have it: ``who``, ``from``."""
        return {"who": self.user or "no name given", "from": f"page, {self.by}"}


@dataclass
class Controls:
    """The one place at the controls; any thread may ask."""

    clock: Callable[[], float] = time.monotonic
    _holder: Principal | None = None
    _seen: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def holder(self) -> Principal | None:
        """Who holds them; None when nobody does, or its browser is gone."""
        with self._lock:
            return self._current()

    def take(self, who: Principal, force: bool = False) -> None:
        """Take them; ``force`` takes them from another.

        Raises
        ------
        NotInControlError
            When another holds them.
        """
        with self._lock:
            held = self._current()
            if held is not None and held.id != who.id and not force:
                raise NotInControlError(
                    f"{held.name or 'another browser'} holds the controls; have it released, or "
                    "take it over"
                )
            self._holder, self._seen = who, self.clock()

    def release(self, who: Principal) -> None:
        """Let go of them; without effect for who doesn't hold them."""
        with self._lock:
            if self._holder and self._holder.id == who.id:
                self._holder = None

    def seen(self, who: Principal) -> None:
        """Note that a browser is still there."""
        with self._lock:
            if self._holder and self._holder.id == who.id:
                self._seen = self.clock()

    def require(self, who: Principal) -> None:
        """Refuse who doesn't hold them; who asks while nobody does takes them."""
        self.take(who)

    def _current(self) -> Principal | None:
        if self._holder is not None and self.clock() - self._seen > LEASE_S:
            self._holder = None
        return self._holder
