"""Stands by a printer: connects it, grants wishes, and notices when it is gone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, Final

from printctl.link.clock import RealClock
from printctl.link.errors import HandshakeError, LinkError, PortLost, Refused
from printctl.link.families import protocol_for
from printctl.link.states import LinkState, PrintEnded
from printctl.link.wiring import Wiring
from printctl.station.counter import ALONE, Counter, Wish, refusal
from printctl.station.hands import AXES, MOTIONS, Hands
from printctl.station.standby import Standby
from printctl.station.status import StationState

IDLE_S: Final = 0.03
"""Longest wait for the printer before wishes are looked at."""


class Attending(Counter, ABC):
    """The thread that owns the port, between prints; see `Counter` for what it is given."""

    @abstractmethod
    def _print(self, wish: Wish) -> None:
        """Print, and stand by again."""

    @abstractmethod
    def _close(self, wish: Wish | None) -> None:
        """Let go of the port."""

    def connect(self, ready: str = "ready") -> None:
        """Open the port, find the printer and check it; ``ready`` is said when that is done.

        Raises
        ------
        LinkError
            When that fails; the port is let go of.
        """
        self._switching = True
        self._tell(StationState.CONNECTING, f"opening {self.socket.port}", error="")
        try:
            self._transport = self.socket.plug_in(self._start)
            self._stand_by(fresh=True)
        except (PrintEnded, LinkError) as exc:
            self._unplug()
            raise exc if isinstance(exc, LinkError) else HandshakeError(exc.message) from exc
        finally:
            self._switching = False
        if self.socket.simulated:  # it stands where it was started, and counts so
            self.hands.declare(self._start, set(AXES))
        self._write_down("state", state="ready", message="connected", port=self.socket.port)
        self._tell(StationState.READY, ready)

    def _stand_by(self, fresh: bool) -> None:
        """Speak through the open port."""
        transport = self._transport
        if transport is None:
            raise PortLost(f"{self.socket.port} isn't open")
        printer = self.known.printer
        wiring = Wiring(
            transport=transport,
            protocol=protocol_for(printer, transport.quiet_s),
            clock=RealClock(),
            journal=self.journal,
            printer=printer,
            fresh=fresh,
        )
        self._standby = Standby(wiring, self.socket.pace, self._tell_live)
        self._streamer = None
        self._switching = False  # a kill finds it from here on
        self._standby.begin()
        self.hands = Hands(self._standby, self.known)

    def _attend(self) -> None:
        wish = self._next()
        if wish is None:
            if self._standby is not None:
                self._standby.rest(IDLE_S)
            return
        try:
            if wish.do == "print":
                self._print(wish)
            elif wish.do == "close":
                self._close(wish)
            elif wish.do == "reconnect":
                raise Refused("the printer is connected; close the station first, or kill")
            else:
                self._grant(wish)
        except (PrintEnded, PortLost) as exc:
            self._answer(wish, refusal(exc if isinstance(exc, LinkError) else LinkError(str(exc))))
            raise
        except LinkError as exc:
            self._answer(wish, refusal(exc))

    def _answer(self, wish: Wish, answer: dict[str, Any]) -> None:
        """Tell how a wish ended; whoever hears it may ask for the next one."""
        with self._lock:
            if wish.do in ALONE:
                self._alone = False
        wish.say(answer)

    def _grant(self, wish: Wish) -> None:
        """Do what is asked for, and answer."""
        self._write_down("asked", do=wish.do, values=_plain(wish.values))
        before = self._status.message
        if wish.do in MOTIONS:
            self._tell(StationState.BUSY, wish.do)
        try:
            if wish.do == "mount":
                answer = self._mount(wish.values)
            else:
                answer = self.hands.wishes[wish.do](wish.values)
        except Refused:
            self._tell(StationState.READY, before)
            raise
        except PortLost:
            raise
        except LinkError as exc:
            self._tell(StationState.READY, str(exc))
            raise
        except (KeyError, TypeError, ValueError, AttributeError) as exc:
            self._tell(StationState.READY, before)
            raise Refused(f"{wish.do} can't be read: {exc!r}") from exc
        self._tell(StationState.READY, str(answer.get("message") or "ready"))
        self._answer(wish, self._reply(wish.do, answer))

    def _mount(self, values: dict[str, Any]) -> dict[str, Any]:
        told = {key: value for key, value in values.items() if key not in ("do", "token")}
        if self.known.printer.heads and {"needle", "dish", "syringe"} & set(told):
            raise Refused(
                f"{self.known.printer.name} has several heads; what each of them holds can't be "
                "told to a station yet, only to a print"
            )
        self.known.mount(told)
        return {}

    def _next(self) -> Wish | None:
        with self._lock:
            self._bell.clear()
            return self._wishes.popleft() if self._wishes else None

    # --- down ----------------------------------------------------------------------------------

    def _go_down(self, exc: PrintEnded | PortLost) -> None:
        """The printer has halted or is gone; nothing is known of its place any more."""
        lost = isinstance(exc, PortLost) or (
            exc.state is LinkState.FAILED or exc.error == PortLost.__name__
        )
        message = str(exc) if isinstance(exc, PortLost) else exc.message
        error = type(exc).__name__ if isinstance(exc, PortLost) else exc.error
        self.down(StationState.LOST if lost else StationState.HALTED, message, error)

    def down(self, state: StationState, message: str, error: str = "") -> None:
        """Take notice that the printer can't be used until it is connected again."""
        if state is StationState.LOST:
            self._unplug()
        if self._standby is not None:
            if self._standby.position is not None:
                self._start = self._standby.position
            self._standby.end()
        self._streamer = None
        self.known.lose_position()
        self._write_down("state", state=state.value, message=message)
        with self._lock:  # what is asked for from here on is of the next connection
            waiting, self._alone = list(self._wishes), False
            self._wishes.clear()
            self._status = replace(self._status, state=state)
        remedy = "" if "reconnect" in message else "; see to the printer, then reconnect"
        self._tell(state, message + remedy, error=error, position_mm=None, temperatures=())
        for wish in waiting:
            wish.say(refusal(LinkError(message)))

    def _wait_down(self) -> None:
        self._bell.wait(0.2)
        wish = self._next()
        if wish is None:
            return
        try:
            if wish.do == "close":
                self._close(wish)
            elif wish.do == "mount":
                self._mount(wish.values)
                self._tell_live()
                self._answer(wish, self._reply("mount", {}))
            else:
                self._reconnect(wish)
        except LinkError as exc:
            self._answer(wish, refusal(exc))

    def _reconnect(self, wish: Wish) -> None:
        self._unplug()
        try:
            self.connect()
        except LinkError as exc:
            self.down(StationState.LOST, str(exc), type(exc).__name__)
            raise
        self._answer(wish, self._reply("reconnect", {}))

    def _unplug(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """What of a wish may stand in a journal."""
    return {key: value for key, value in values.items() if key not in ("do", "token")}
