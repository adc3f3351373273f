"""Clients of a machine process: of the print that it does, or of the printer that it keeps.

A client may go away at any time; neither the print nor the station minds. Every request opens a
connection of its own, so that one client may be used by several threads and nothing stands in the
way of a kill; what is heard of comes by another one, which finds the process again where it broke.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from printctl.machine.control.idle.station_status import NO_PRINTER, StationState, StationStatus
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import BY_NAME, AlreadyPrinting, LinkError, NoLink, Refused
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.ports.detection import runs_files
from printctl.machine.process.clients.launch import START_LIMIT_S
from printctl.machine.process.contact import (
    STATION_LOCK,
    STATION_LOG,
    alive,
    last_word,
    load_station,
    stays_alive,
)
from printctl.machine.process.outcome import may_still_move, read_outcome
from printctl.machine.process.socket_server import open_address
from printctl.machine.records.actor import actor
from printctl.machine.records.record import LOG, ContactRecord, load_record
from printctl.machine.records.states import EARLY, LinkState, Status, state_words

if TYPE_CHECKING:
    from printctl.machine.process.orders import Order

SOON_S: Final = 10.0
"""Longest wait for an answer that nothing has to be done for."""
PATIENCE_S: Final = 60.0
"""For an answer that waits for the line in flight, or for a step of the print to end."""
MOVE_S: Final = 600.0
"""Longest wait for the end of a move: a slow axis, all of its way."""
CHECK_S: Final = 180.0
"""Longest wait for a printer that is connected, or a print that begins."""
_STATUS_S: Final = 5.0
_AGAIN_S: Final = 0.02
_CHUNK: Final = 65536
_FIRST_BYTES: Final = 10_000
"""More than that a process takes only from a client that it knows."""

Message = dict[str, Any]


class Connection:
    """One connection to a machine process."""

    def __init__(self, end: socket.socket, token: str) -> None:
        self.socket, self._token, self._heard = end, token, b""
        self.open = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave; a thread that listens here ends."""
        self.open = False
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()

    def send(self, do: str, **values: Any) -> None:
        """Send a request; OSError when the process has gone."""
        data = _line(do, self._token, values)
        first = b"" if len(data) < _FIRST_BYTES else _line("detach", self._token, {})
        self.socket.sendall(first + data)

    def messages(self, timeout: float | None) -> Iterator[Message]:
        """Give what the process sends, until it hangs up (`open` is false then) or in time."""
        limit = None if timeout is None else time.monotonic() + timeout
        while self.open:
            while b"\n" in self._heard:
                line, self._heard = self._heard.split(b"\n", 1)
                yield json.loads(line)
            left = None if limit is None else limit - time.monotonic()
            if left is not None and left <= 0:
                return
            try:
                self.socket.settimeout(left)
                data = self.socket.recv(_CHUNK)
            except TimeoutError:
                return
            except OSError:
                data = b""
            if not data:
                self.open = False
            self._heard += data


def _line(do: str, token: str, values: dict[str, Any]) -> bytes:
    return json.dumps({"do": do, "token": token, "by": actor(), **values}).encode() + b"\n"


class Client:
    """What clients of a print and of a station have in common."""

    _what, _log, _comes_up_s = "station", STATION_LOG, 5.0

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def _contact(self) -> ContactRecord | None:
        """Return where the process listens; None when it has ended."""
        return load_station(self.folder)

    def _alive(self) -> bool:
        return alive(self.folder, STATION_LOCK)

    def _about(self) -> dict[str, str]:
        """Return the values of a request that say what it is about."""
        return {}

    def connection(self) -> Connection | None:
        """Connect to the process; None when it has gone, NoLink when it can't be reached."""
        limit = time.monotonic() + self._comes_up_s
        while (contact := self._contact()) is not None:
            end = open_address(contact.address)
            if end is not None:
                return Connection(end, contact.token)
            if not self._alive():
                return None
            if time.monotonic() > limit:
                raise self._silent()
            time.sleep(_AGAIN_S)
        return None

    def send(self, do: str, /, **values: Any) -> bool:
        """Send a request without waiting for an answer; False where the process has gone."""
        while (connection := self.connection()) is not None:
            with connection:
                try:
                    connection.send(do, **self._about(), **values)
                    return True
                except OSError:
                    continue  # it was about to end
        return False

    def request(self, do: str, patience_s: float, /, **values: Any) -> Message | None:
        """Send a request and return the answer; None when the process has gone, or left it.

        Raises
        ------
        LinkError
            As the process refuses it; `NoLink` without an answer within ``patience_s``.
        """
        while (connection := self.connection()) is not None:
            with connection:
                try:
                    connection.send(do, **self._about(), answer=True, **values)
                except OSError:
                    continue  # it was about to end
                for message in connection.messages(patience_s):
                    if message.get("over"):
                        return None
                    if message["event"] == "refused":
                        raise error_of(message.get("error", ""), message["message"])
                    return message
                if connection.open:
                    raise NoLink(f"no answer to {do!r} within {patience_s:g} s: {self._silent()}")
                return None
        return None

    def _silent(self) -> NoLink:
        return NoLink(
            f"the {self._what} of {self.folder} doesn't answer; see {self.folder / self._log}"
        )


class PrintClient(Client):
    """One client of one print; made by `start_print`, `Station.print` or `attach`.

    It lets go of its connection when it has heard of the end, on `detach`, and at the end of a
    ``with`` block; the print goes on. Requests to a print that has ended raise `Refused`, which
    says how it ended; to one whose process died, `NoLink`. `stop` and `kill` do nothing where the
    printer stands already; where it may still move, `kill` halts it.

    Attributes
    ----------
    record : ContactRecord
        What the process wrote down of itself.
    """

    _what, _log, _comes_up_s = "link process", LOG, START_LIMIT_S

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.record = load_record(folder)
        self._last: Status | None = None
        self._stream: Connection | None = None
        self._subscribed()  # what comes from here on is heard of

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self.detach()

    def _contact(self) -> ContactRecord | None:
        record = load_record(self.folder)
        if self.record.print_id not in ("", record.print_id):
            raise NoLink(f"another print was begun in {self.folder} since; attach to that one")
        self.record = record
        return None if record.status else record

    def _alive(self) -> bool:
        return alive(self.folder)

    def _about(self) -> dict[str, str]:
        return {"print": self.record.print_id}

    def detach(self) -> None:
        """Leave; the print goes on."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    # --- what a client may ask for ---------------------------------------------------------------

    def stop(self) -> None:
        """Ask for a controlled stop: end the line in flight, relieve the plunger, lift.

        A print that has ended is left as it is; `NoLink` where its printer may still move, for
        nobody speaks to it any more.
        """
        if not self.send("stop") and may_still_move(self.status):
            raise self._nobody_speaks()

    def kill(self) -> None:
        """Halt the firmware at once; afterwards the position is unknown.

        Where nobody speaks to the printer any more and it may still move, as after the process has
        died, the print's port is opened and the halt written to it: LinkError when that can't be
        done, or isn't confirmed. A print that has ended otherwise is left as it is; a network
        host's is halted where the host runs its file again, else Refused, as where it runs another.
        """
        if files := runs_files(self.record.port):
            sent = True
            with contextlib.suppress(NoLink):  # its halt doesn't wait for the answer either
                sent = self.request("kill", SOON_S) is not None
        else:
            sent = self.send("kill")
        if not sent and (may_still_move(self.status) or files):
            # The link itself: slow to import.
            from printctl.machine.process.clients.kill_unlinked import kill_unlinked

            self._hear(kill_unlinked(self.folder))

    def pause(self, after: MarkKind | None = None) -> None:
        """Ask for a pause: relieve the plunger, lift, hold.

        Now, or ``after`` a layer or vessel; Refused when the job marks no such end ahead.
        """
        self._demand("pause", SOON_S, after=after)

    def reload(self, head: int | None = None) -> None:
        """Ask for a change of syringe: at the next reload point, or here when it is paused.

        Of several heads that of ``head``, or of the one in use. Refused when the job marks no
        reload point ahead.
        """
        self._demand("reload", SOON_S, head=head)

    def resume(
        self,
        change: NewSyringe | None = None,
        unchanged: bool = False,
        unobserved: bool = False,
    ) -> None:
        """Go on after a pause; `Streamer.resume` says what may be told.

        Returns once the print goes on. Refused, with the reason, when it stays paused, isn't paused
        or has ended; LinkError when it hasn't gone on within `PATIENCE_S`.
        """
        new = asdict(change) if change else None
        try:
            answer = self.request(
                "resume", PATIENCE_S, change=new, unchanged=unchanged, unobserved=unobserved
            )
        except NoLink as exc:
            raise LinkError(
                f"the print in {self.folder} hasn't said within {PATIENCE_S:g} s whether it goes "
                "on; `printctl status RUN` tells"
            ) from exc
        if answer is None:
            raise self._too_late()

    def alive(self) -> None:
        """Confirm that somebody is there: the dead-man's time begins anew."""
        self._demand("alive", SOON_S)

    def command(self, text: str) -> list[str]:
        """Send a manual command between two lines of the job; give the printer's reply.

        LinkError when the print ends first.
        """
        answer = self.request("command", PATIENCE_S, text=text)
        if answer is None:
            raise LinkError(f"no reply to {text!r}: the print ended first")
        return list(answer["lines"])

    def insert(
        self,
        look: int,
        lines: Sequence[str],
        why: str = "",
        flow: float | None = None,
        again: bool = False,
    ) -> Message:
        """Put lines into the job where the print is held for a look.

        Parameters
        ----------
        look : int
            Number of the look (`Status.look`).
        lines : sequence of str
            One command each; they must end where the print is held.
        why : str
            For the journal.
        flow : float, optional
            What the job's moves that write push from there on, by what the file says: 1.1 for a
            tenth more. ``lines`` may be empty with it.
        again : bool
            Another look is made once the lines are written.

        Returns
        -------
        dict
            ``look``, ``after`` (lines of the job before them), ``count``, ``sha256``, ``flow``. The
            same insert again gives the same answer; a different one is Refused.
        """
        given = {"lines": list(lines), "why": why, "flow": flow, "again": again}
        return self._of_look("insert", look, given)

    def decide(
        self, look: int, decision: LookDecision, why: str = "", again: bool = False
    ) -> Message:
        """End a look; return what is in the journal of it.

        With ``again`` it failed: after the pause it is made again, once at a place. Refused when no
        such look is going on, or it was decided otherwise.
        """
        given = {"decision": str(decision), "why": why, "again": again}
        return self._of_look("look_done", look, given)

    def _of_look(self, do: str, look: int, given: dict[str, Any]) -> Message:
        answer = self.request(do, PATIENCE_S, look=look, **given)
        if answer is None:
            raise LinkError(f"no answer on look {look}: the print ended first")
        return answer

    def _demand(self, do: str, patience_s: float, **values: Any) -> Message:
        answer = self.request(do, patience_s, **values)
        if answer is None:
            raise self._too_late()
        return answer

    def _too_late(self) -> LinkError:
        """Return why nothing can be requested of a print whose process has gone."""
        status = self.status
        if status.state is LinkState.INTERRUPTED:
            return self._nobody_speaks()
        words = f"{state_words(status.state)}: {status.message}"
        return Refused(f"the print in {self.folder} has ended ({words}); nothing was requested")

    def _nobody_speaks(self) -> NoLink:
        status = self.status
        return NoLink(
            f"nobody speaks to the printer of {self.folder} any more ({state_words(status.state)}: "
            f"{status.message}); nothing was requested. `printctl emergency-stop` halts it, "
            "`printctl resume` goes on where that is possible"
        )

    # --- what a client may hear ------------------------------------------------------------------

    @property
    def status(self) -> Status:
        """The print as it is now; asks its process, and reads its records where that has gone."""
        while self._last is None or not self._last.ended:
            answer = self.request("status", _STATUS_S, of="print")
            if answer is not None:
                return self._hear(Status.from_dict(answer))
            if self._over():
                return self._hear(read_outcome(self.folder))
        return self._last

    def events(self) -> Iterator[Status]:
        """Give the status as it is known, if it is, then each as it comes; the last one has ended.

        What `start_print` heard last is given again, and what another call did: a print may stand
        still in it, as in a look, until somebody decides.
        """
        given = None
        while True:
            while self._last is not None and self._last is not given:
                given = self._last
                yield given
                if given.ended:
                    return
            self._next(None)

    def wait(self, timeout: float | None = None) -> Status:
        """Wait for the end of the print; TimeoutError when it isn't over after ``timeout`` s."""
        limit = math.inf if timeout is None else time.monotonic() + timeout
        while self._last is None or not self._last.ended:
            left = None if timeout is None else limit - time.monotonic()
            if self._next(left) is None and time.monotonic() >= limit:
                raise TimeoutError(f"the print in {self.folder} isn't over after {timeout} s")
        return self._last

    def _next(self, timeout: float | None) -> Status | None:
        """Wait for the next status, the last one where the process has gone; None in time."""
        limit = None if timeout is None else time.monotonic() + timeout
        while (stream := self._subscribed()) is not None:
            left = None if limit is None else limit - time.monotonic()
            for message in stream.messages(left):
                if message["event"] != "status":
                    stream.close()  # the print is over, and its end is being written down
                    break
                return self._hear(Status.from_dict(message))
            if stream.open:
                return None
            self.detach()
            if self._over():
                break
        return self._hear(read_outcome(self.folder))

    def _over(self) -> bool:
        """Whether the process that hung up has done with the print; else give it a moment.

        On a full disk its record doesn't say so, and a station goes on listening at its address:
        then the folder's lock does.
        """
        if self._contact() is None or not self._alive():
            return True
        time.sleep(_AGAIN_S)
        return False

    def _subscribed(self) -> Connection | None:
        """Return the connection by which it hears of the print, made anew where it broke."""
        while self._stream is None and (stream := self.connection()) is not None:
            try:
                stream.send("subscribe", of="print", **self._about())
                self._stream = stream
            except OSError:  # it was about to end
                stream.close()
        return self._stream

    def _hear(self, status: Status) -> Status:
        self._last = status
        if status.ended:
            self.detach()
        return status


def attach(folder: Path) -> PrintClient:
    """Attach to the print in ``folder``, which may be over; NoLink when none was started there."""
    return PrintClient(folder)


def wait_for_first_lines(client: PrintClient, done: int = 0) -> PrintClient:
    """Wait until the first lines of a print go out, behind ``done`` of an earlier process.

    Raises
    ------
    LinkError
        When it fails before.
    """
    for status in client.events():
        if status.state not in EARLY:
            break
    status = client.status
    if status.ended and status.lines_done == done and status.error:
        raise error_of(status.error, status.message)
    return client


def error_of(name: str, message: str) -> LinkError:
    """Return the error that another process has met, by its class's name."""
    return BY_NAME.get(name, LinkError)(message)


class Station(Client):
    """One client of a station; made by `connect` or `attach`.

    Every request is done when its call returns, and gives the status after it. What can't be
    granted raises `printctl.machine.errors.Refused`; a station that is gone, `NoLink`; a
    printer that fails meanwhile, another `LinkError`.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._listening: list[Connection] = []
        self._lock = threading.Lock()

    # --- what a client may hear ----------------------------------------------------------------

    @property
    def status(self) -> StationStatus:
        """The station as it is now; of one that has gone, the last word, as closed or lost."""
        try:
            answer = self.request("status", SOON_S, of="printer")
        except NoLink:
            if self._alive():
                raise
            answer = None
        return last_word(self.folder) if answer is None else StationStatus.from_dict(answer)

    def events(self) -> Iterator[StationStatus]:
        """Give each status as it comes, the present one first; ends when the station closes."""
        last, left = None, False
        connection = self.connection()
        if connection is not None:
            with self._lock:
                self._listening.append(connection)
            try:
                connection.send("subscribe", of="printer")
                for message in connection.messages(None):
                    last = StationStatus.from_dict(message)
                    yield last
            except OSError:  # it has just ended
                pass
            finally:
                with self._lock:
                    left = connection not in self._listening
                    self._listening = [one for one in self._listening if one is not connection]
                connection.close()
        if not left and (last is None or last.state is not StationState.CLOSED):
            yield last_word(self.folder)

    def detach(self) -> None:
        """End `events` from any thread; the station goes on."""
        with self._lock:
            listening, self._listening = self._listening, []
        for connection in listening:
            connection.close()

    # --- ends and emergencies --------------------------------------------------------------------

    def close(self) -> None:
        """Switch heaters off, let go of the port and end the process; refused while it moves."""
        self._ask("close", MOVE_S)
        limit = time.monotonic() + SOON_S
        while self._alive() and time.monotonic() < limit:
            time.sleep(0.02)

    def kill(self) -> None:
        """Halt the firmware past all queues, from any state and thread; nothing can block it.

        Where the station's process has died, its port is opened and the halt written to it:
        LinkError when that can't be done, or isn't confirmed. `NoLink` where it was closed.
        """
        if self.request("kill", SOON_S) is not None:
            return
        if stays_alive(self.folder, STATION_LOCK):
            raise self._silent()
        # The link itself: slow to import.
        from printctl.machine.process.clients.kill_unlinked import kill_unlinked_station

        kill_unlinked_station(self.folder)

    def stop_motion(self) -> StationStatus:
        """End a move by hand after at most half a second of it; the position stays known.

        Refused while the printer is homing: only `kill` ends that.
        """
        return self._request("stop_motion", SOON_S)

    def reconnect(self) -> StationStatus:
        """Open the port again and check the printer, after ``halted`` or ``lost``."""
        return self._request("reconnect", CHECK_S)

    # --- moves -----------------------------------------------------------------------------------

    def jog(
        self, axis: str | Mapping[str, float], mm: float = 0.0, speed_mm_s: float | None = None
    ) -> StationStatus:
        """Move the tip by ``mm`` along an axis, or by several axes' ``{"x": 1.0, "y": -1.0}``.

        Without a speed: 5 mm/s, or what the machine's slowest axis can.
        """
        by = {axis: mm} if isinstance(axis, str) else dict(axis)
        return self._request("jog", MOVE_S, by=by, speed_mm_s=speed_mm_s)

    def move_to(
        self,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        *,
        speed_mm_s: float | None = None,
    ) -> StationStatus:
        """Move the tip in a straight line to a place; refused unless the position is trusted."""
        return self._request("move_to", MOVE_S, x=x, y=y, z=z, speed_mm_s=speed_mm_s)

    def home(
        self, axes: Sequence[str] = ("x", "y", "z"), *, needle_off: bool = False
    ) -> StationStatus:
        """Home axes; refused with a needle mounted, unless it is taken off now (``needle_off``)."""
        return self._request("home", MOVE_S, axes=list(axes), needle_off=needle_off)

    def heat(self, name: str, celsius: float) -> StationStatus:
        """Set a heater's target (``nozzle``, ``bed``), 0 for off; doesn't wait for it."""
        return self._request("heat", MOVE_S, name=name, celsius=celsius)

    def plunger(self, ul: float, ul_s: float | None = None) -> StationStatus:
        """Push (above 0) or draw back so many µL, measured by the syringe mounted."""
        return self._request("plunger", MOVE_S, ul=ul, ul_s=ul_s)

    def command(self, text: str) -> list[str]:
        """Send a line by the console; while a print goes on, through its link. Give the reply."""
        return list(self._ask("command", MOVE_S, text=text)["lines"])

    # --- what the user tells ---------------------------------------------------------------------

    def mount(self, **parts: Any) -> StationStatus:
        """Say what is mounted: the fields of `Mounted`, and ``plunger_mm`` of a syringe put in.

        Keys left out stay as they are; ``""`` (or None) takes away. Another needle or dish must be
        touched off anew. A syringe that is named is full, unless ``plunger_mm`` says otherwise.
        """
        return self._request("mount", MOVE_S, **parts)

    def touch_off(self, z: float | None = None, *, foil_mm: float = 0.0) -> StationStatus:
        """Say that the tip touches the floor: here, or at ``z``, less the foil it stands on."""
        return self._request("touch_off", MOVE_S, z=z, foil_mm=foil_mm)

    def set_position(
        self, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> StationStatus:
        """Tell the printer where its tip stands (G92); nothing moves."""
        return self._request("set_position", MOVE_S, x=x, y=y, z=z)

    # --- prints ----------------------------------------------------------------------------------

    def print(self, order: Order) -> PrintClient:
        """Print on the open port; gives a client of the print, once its first lines go out.

        Refused for another printer's job, a tip that isn't where the job declares it, an order to
        go on with a print (`printctl resume` does that, without a station).
        """
        if order.resume:
            raise Refused(
                "a station has numbered the printer's lines anew, so an interrupted print can't be "
                "gone on with through it; see `printctl recover`"
            )
        if stays_alive(order.folder):
            raise AlreadyPrinting(f"a print is running in {order.folder}; attach to it")
        self._ask("print", CHECK_S, order=order.to_json())
        return wait_for_first_lines(attach(order.folder))

    def _request(self, do: str, patience_s: float, **values: Any) -> StationStatus:
        return StationStatus.from_dict(self._ask(do, patience_s, **values)["status"])

    def _ask(self, do: str, patience_s: float, **values: Any) -> Message:
        lived = self._alive()
        answer = self.request(do, patience_s, **values)
        if answer is not None:
            return answer
        if stays_alive(self.folder, STATION_LOCK):
            raise self._silent()
        if lived and last_word(self.folder).state is not StationState.CLOSED:
            raise LinkError(
                f"the station's process ended before it had answered ({do}): what moves may move "
                "on, and heaters stay on; `printctl station emergency-stop` halts the printer, its "
                "power ends both"
            )
        raise NoLink(NO_PRINTER)


def attach_station(folder: Path) -> Station:
    """Attach to the station of ``folder``, even a closed one; NoLink when there was none."""
    load_station(folder)
    return Station(folder)
