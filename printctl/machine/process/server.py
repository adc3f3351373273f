"""Command socket server of a print's link process: pause, resume, reload, inserts, stop, status.

Besides what every command socket knows (`printctl.machine.process.command_socket`) a client may
request ``stop``, ``pause`` (with ``after``: layer, vessel or nothing), ``reload`` (with ``head``,
of several), ``resume`` (with ``change``, the fields of `NewSyringe`, or ``unchanged``; with
``unobserved`` a look that failed isn't made again), which is answered by ``{"event": "resumed"}``
once the print goes on, or refused, ``alive``, and ``command`` (with ``text``), which is answered by
``{"event": "reply", "command": ..., "lines": [...]}``.

While the state is ``looking`` (``look`` of the status says which): ``insert`` (with ``look``,
``lines``, ``why``, perhaps ``flow``, and ``again`` for another look behind them), answered by
``{"event": "inserted", "look", "after", "count", "sha256", "flow"}`` once it is in the journal; and
``look_done`` (with ``look``, ``decision``: go_on, pause, stop; ``why``; ``again`` where it failed),
answered by ``{"event": "looked", "look", "decision", "why"}``. Saying one of them again gives the
same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from printctl.machine.control.look_book import LookDecision
from printctl.machine.control.streamer import Streamer
from printctl.machine.errors import Refused
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.process.command_socket import SocketServer, forget, listen
from printctl.machine.process.request_values import (
    flag,
    one_of,
    perhaps_number,
    perhaps_object,
    perhaps_whole,
    text,
    texts,
    whole,
)
from printctl.machine.process.socket_clients import ClientPlace
from printctl.machine.records.states import Status

__all__ = ["Server", "forget", "listen"]


@dataclass
class Server(SocketServer):
    """Serves the clients of a print.

    Attributes
    ----------
    streamer : Streamer
    """

    streamer: Streamer

    def kill(self) -> None:
        """Halt the printer."""
        self.streamer.kill()

    def told(self) -> dict[str, Any]:
        """The print's status."""
        return self.streamer.status.to_dict()

    def requests(self) -> Mapping[str, Callable[[ClientPlace, dict[str, Any]], None]]:
        """What else may be requested of a print."""
        return {
            "stop": self._do_stop,
            "pause": self._do_pause,
            "reload": self._do_reload,
            "alive": self._do_alive,
            "resume": self._do_resume,
            "command": self._do_command,
            "insert": self._do_insert,
            "look_done": self._do_look_done,
        }

    def publish(self, status: Status) -> None:
        """Tell all subscribers; from any thread, never waiting."""
        self.tell_all(status.to_dict())

    def _do_stop(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        self.streamer.stop()

    def _do_pause(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        after = request.get("after")
        self.streamer.pause(None if after is None else one_of(request, "after", MarkKind))
        self.publish(self.streamer.status)

    def _do_reload(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        head = perhaps_whole(request, "head")
        self.streamer.reload(*(() if head is None else (head,)))
        self.publish(self.streamer.status)

    def _do_resume(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        change = perhaps_object(request, "change")
        unchanged = flag(request, "unchanged")
        unobserved = flag(request, "unobserved")

        def answer(why: str) -> None:
            if why:
                self._refuse(guest, why)
            else:
                self.post(guest, {"event": "resumed"})

        new = NewSyringe(**change) if change else None
        self.streamer.resume(new, unchanged, unobserved, answer)

    def _do_alive(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        self.streamer.alive()

    def _do_command(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        typed = text(request, "text")

        def done(lines: tuple[bytes, ...]) -> None:
            said = [line.decode("ascii", "backslashreplace") for line in lines]
            self.post(guest, {"event": "reply", "command": typed.strip(), "lines": said})

        self.streamer.typed(typed, done, partial(self._refuse, guest))

    def _do_insert(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        self.streamer.insert(
            whole(request, "look"),
            texts(request, "lines"),
            text(request, "why", ""),
            partial(self.post, guest),
            partial(self._refuse, guest),
            perhaps_number(request, "flow"),
            flag(request, "again"),
        )

    def _do_look_done(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        done, refused = partial(self.post, guest), partial(self._refuse, guest)
        decision = one_of(request, "decision", LookDecision)
        why = text(request, "why", "")
        again = flag(request, "again")
        self.streamer.look_done(whole(request, "look"), decision, why, done, refused, again)

    def _refuse(self, guest: ClientPlace, why: str) -> None:
        self.post(guest, {"event": "refused", "message": why, "error": Refused.__name__})
