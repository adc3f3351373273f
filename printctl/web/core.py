"""Settings, workspace, control lock and event publisher of one web server, for all its pages."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any, Final

from printctl.web.controls import Controls
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

_WAITING: Final = 64


class Events:
    """Hands messages from any thread to the listeners of one event loop.

    A listener that is too slow loses the oldest; each message is a whole state, not a change.
    """

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._queues: set[asyncio.Queue[dict[str, Any]]] = set()
        self.latest: dict[str, dict[str, Any]] = {}

    def bind(self, loop: asyncio.AbstractEventLoop) -> None:
        """Use this loop from now on."""
        self._loop = loop

    def publish(self, event: str, **values: Any) -> None:
        """Tell all; from any thread, never waiting. ``latest`` keeps the last of each event."""
        message = {"event": event, **values}
        self.latest[event] = message
        if self._loop is not None and not self._loop.is_closed():
            with contextlib.suppress(RuntimeError):  # the loop ends this moment
                self._loop.call_soon_threadsafe(self._spread, message)

    async def listen(self) -> AsyncIterator[dict[str, Any]]:
        """Give the last of each event, then each message as it comes."""
        queue: asyncio.Queue[dict[str, Any]] = asyncio.Queue(_WAITING)
        self._queues.add(queue)
        try:
            for message in list(self.latest.values()):
                yield message
            while True:
                yield await queue.get()
        finally:
            self._queues.discard(queue)

    def _spread(self, message: dict[str, Any]) -> None:
        for queue in self._queues:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(message)


@dataclass(frozen=True)
class Core:
    """Settings, workspace, controls and news of one server."""

    settings: ServeSettings
    workspace: Workspace
    controls: Controls = field(default_factory=Controls)
    events: Events = field(default_factory=Events)
