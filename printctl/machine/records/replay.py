"""A print's state: what replaying its journal gives, for resume, recover, history and page."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from printctl.machine.errors import JournalError
from printctl.machine.job.job import Insert
from printctl.machine.job.marks import Position
from printctl.machine.job.syringes import Filling
from printctl.machine.records.journal import (
    RESERVE,
    Record,
    bytes_in,
    decode,
    print_id,
    read_records,
)
from printctl.machine.records.states import EARLY, LinkState

_AT_WORK: Final = (LinkState.PRINTING, LinkState.PAUSING)
"""In both the job's moves are made: a pause is reached when those that were sent are done."""
_MAX_PACES: Final = 1000


UNANSWERED: Final = "begun, unanswered"
"""Step of a file on a network host: it has begun, and its start, unanswered, may come late."""


@dataclass
class JournalledPrint:
    """What a journal says about its print; records are as in `journal.py`, times s since 1970.

    Attributes
    ----------
    job, first_job : dict
        The last job record, with the print's ``id``, and the first; empty when that is lost.
    begun : bool
        Whether the handshake was through and job lines may have been sent.
    done : int
        Command lines known to be taken: at least so many.
    alarms, alarm_times : list of str, list of float
        Each once, when it came first; of one that came again how often.
    paces : list of (int, float, int)
        Commands taken and time without pauses, s, at moments of the print, `_MAX_PACES` at most;
        and how often it had been held or resumed: what was made meanwhile took no such time.
    made : int
        Command lines that were made for certain when the motors last stood.
    reload, syringe : dict or None
        Of a change of syringe after which the print hasn't gone on.
    reloaded : int
        Command lines after which the last change was made; -1 for none.
    filled : dict of (int or None) to Filling
        What was put in at changes of syringe, by head; the last change last.
    look : dict or None
        One that was begun and isn't decided.
    park : tuple of float or None, mm
        Where the needle was led for a look after which the print hasn't gone on.
    heard : float or None
        Last word of the print before attempts to go on that didn't find the printer; None for none.
    over : bool
        Whether the last attempt has ended: an end record follows its job record.
    damaged, gaps : int
        Lines with a wrong checksum, or values that no record has, a torn last one included; those
        of them after which the same link process wrote on: no torn ends, but missing records, so
        that lines can't be counted.
    cut_short : bool
        Whether the disk was full, and the last attempt's end, or what came before it, isn't there.
    written_s : float
        Last word of the print, attempts that didn't find the printer aside; by the file's time.
    last_at : float
        Of the last record that has a time.
    active_s, since : float, float or None
        Time in which it was printing, pauses left out, up to ``since`` or the end, s; since when
        it has been printing without a pause, None while it isn't.
    in_ink : bool
        Whether the needle stood at the job's place at the last record.
    stopping : bool
        Whether it had begun to end the print: needle up, heaters perhaps off.
    hosted : (str, str)
        Last step of a print on a network host (``selected``, ``start``, ``begun``, ``deleted``)
        and its file there.
    capabilities : dict of str to bool
        Of the firmware, as it has reported them; empty where it hasn't.
    """

    job: Record = field(default_factory=dict)
    first_job: Record = field(default_factory=dict)
    attempts: int = 0
    state: LinkState = LinkState.CONNECTING
    begun: bool = False
    message: str = ""
    done: int = 0
    controls: dict[int, str] = field(default_factory=dict)
    alarms: list[str] = field(default_factory=list)
    alarm_times: list[float] = field(default_factory=list)
    last_alarm: str = ""
    checkpoint: Record | None = None
    checkpoints: list[Record] = field(default_factory=list)
    paces: list[tuple[int, float, int]] = field(default_factory=list)
    made: int = 0
    left: dict[str, float] = field(default_factory=dict)
    wanted: Record | None = None
    reload: Record | None = None
    syringe: Record | None = None
    reloaded: int = -1
    reload_at: tuple[int, ...] | None = None
    reload_heads: tuple[int, ...] = ()
    filled: dict[int | None, Filling] = field(default_factory=dict)
    inserts: list[Insert] = field(default_factory=list)
    look: Record | None = None
    looked: list[Record] = field(default_factory=list)
    park: tuple[float, float, float] | None = None
    stood: Record | None = None
    hosted: tuple[str, str] = ("", "")
    heard: float | None = None
    end: Record | None = None
    over: bool = False
    damaged: int = 0
    gaps: int = 0
    cut_short: bool = False
    written_s: float = 0.0
    last_at: float = 0.0
    active_s: float = 0.0
    since: float | None = None
    in_ink: bool = False
    stopping: bool = False
    capabilities: dict[str, bool] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    heat: Record = field(default_factory=dict)
    frame: Record = field(default_factory=dict)
    _first_alarms: list[str] = field(default_factory=list, repr=False)
    _pace_every_s: float = 1.0
    _stretch: tuple[int, float] = 0, 0.0
    """How often the print has gone on, and its time without pauses then, s."""
    _torn: bool = False
    _seeking: bool = False
    """Going on with a printer that isn't proved yet to be the print's own: what is known stays."""

    @property
    def print_id(self) -> str:
        """Identity of the print; empty without a job record."""
        return print_id(self.job) if self.job else ""

    @property
    def started(self) -> float:
        """When the print was begun, s since 1970; 0 where unknown."""
        return float(self.first_job.get("started", 0.0))

    @property
    def sha256(self) -> str:
        """Hash of the file that is printed; empty where unknown."""
        return str(self.first_job.get("sha256", ""))

    @property
    def unanswered(self) -> str:
        """File of a start that a network host may receive late; empty where none is open."""
        step, file = self.hosted
        return file if step in ("start", UNANSWERED) else ""

    @property
    def total(self) -> int:
        """Command lines in the job, with what was put in."""
        return int(self.job.get("lines", 0)) + sum(len(one.lines) for one in self.inserts)

    @property
    def positions(self) -> tuple[Position, ...]:
        """Where inserts stand in the grown job, and how many lines each has."""
        return tuple((one.after, len(one.lines)) for one in self.inserts)

    @property
    def last_filling(self) -> Filling | None:
        """What was put in at the last change of syringe, of whatever head; None without one."""
        return next(reversed(self.filled.values()), None)

    @property
    def stood_mm(self) -> tuple[float, float, float] | None:
        """Where the printer said that it stood when the print's end dropped its moves, mm."""
        place = (self.stood or {}).get("place") or {}
        x, y, z = (place.get(axis) for axis in "xyz")
        return None if x is None or y is None or z is None else (float(x), float(y), float(z))

    def active_until(self, now: float) -> float:
        """Time without pauses until ``now`` (s since 1970), s."""
        return self.active_s + (max(now - self.since, 0.0) if self.since is not None else 0.0)

    def job_line(self, number: int) -> int:
        """Job lines taken when the printer's last line number is ``number``."""
        return number - sum(1 for control in self.controls if control <= number)

    def changing(self, number: int) -> bool:
        """Whether a change of syringe is open: begun, and the plunger not yet counted anew.

        ``number`` is the printer's last line: one above it was written down, not taken.
        """
        if self.reload is None:
            return False
        counted = self.syringe
        if counted is None or counted["n"] > number:
            return True
        return self.controls.get(counted["n"]) != counted["command"]

    def apply(self, record: Record | None) -> None:
        """Take in the journal's next record; None for a damaged one."""
        sort = record.get("t") if record else None
        if record is None or sort is None:
            self.damaged, self._torn = self.damaged + 1, True
            return
        if self._torn:  # a process that begins, or whose disk was full for a while, may go on there
            self._torn, begins = False, record.get("state") == LinkState.CONNECTING
            self.gaps += not (sort in ("job", "end") or begins)
        act = _BY_SORT.get(str(sort))
        try:
            if act is not None:
                act(self, record)
            if "at" in record:
                self.last_at = max(self.last_at, record["at"])
        except (TypeError, ValueError, LookupError, AttributeError):  # written by something else
            self.damaged, self._torn = self.damaged + 1, True


def read_journal(path: Path) -> JournalledPrint:
    """Read a journal up to its last intact record; raise `JournalError` without such a file."""
    try:
        history = replay(read_records(path))
        history.written_s = history.heard or path.stat().st_mtime
    except OSError as exc:
        raise JournalError(f"journal {path} can't be read: {exc.strerror}") from exc
    reserve = path.with_name(RESERVE)
    emptied = reserve.exists() and not bytes_in(reserve)
    history.cut_short = (not history.over and emptied) or bool((history.end or {}).get("lost"))
    return history


def read_journal_if_any(path: Path) -> JournalledPrint:
    """Read a journal; one that can't be read counts as empty."""
    try:
        return read_journal(path)
    except JournalError:
        return JournalledPrint()


def replay(records: Iterable[Record | None]) -> JournalledPrint:
    """Return what a journal's records say, None standing for a damaged one."""
    history = JournalledPrint()
    for record in records:
        history.apply(record)
    return history


class JournalReader:
    """Reads a journal that grows: each time only what was added, begun anew with another file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._history = JournalledPrint()
        self._file, self._read_bytes = 0, 0

    def read(self) -> JournalledPrint:
        """Return the print up to the last whole line, the same object as before; empty for none."""
        try:
            with self._path.open("rb") as handle:
                there = os.fstat(handle.fileno())
                if there.st_ino != self._file or there.st_size < self._read_bytes:
                    self._history, self._file, self._read_bytes = JournalledPrint(), there.st_ino, 0
                handle.seek(self._read_bytes)
                for line in handle:
                    if not line.endswith(b"\n"):
                        break
                    self._read_bytes += len(line)
                    self._history.apply(decode(line))
        except OSError:
            pass
        return self._history


def _job(known: JournalledPrint, record: Record) -> None:
    begun = bool(known.job)
    known.first_job = known.first_job or record
    known.job = {**record, "id": print_id(known.job if begun else record)}
    # Where its process died, nobody knows for how long it went on after its last record.
    known.active_s, known.since = known.active_until(known.last_at), None
    known.attempts, known.over = known.attempts + 1, False
    known._seeking, known.heard = begun, known.heard or record.get("heard")


def _state(known: JournalledPrint, record: Record) -> None:
    _count_time(known, record, record["state"] in _AT_WORK)
    if known._seeking and record["state"] in EARLY:
        return
    known.state, known.end = LinkState(record["state"]), None  # of an attempt before
    known.stopping |= known.state is LinkState.STOPPING
    known.in_ink &= not known.stopping
    if known.state is LinkState.PAUSED:
        known.wanted = None
    if known.state is LinkState.PRINTING:  # whatever change of syringe there was is made
        known.begun, known.park, known.in_ink = True, None, True
        if known.reload is not None:
            known.reloaded = known.reload["done"]
        known.reload = known.syringe = None
    known.message = record.get("message", "")


def _count_time(known: JournalledPrint, record: Record, works: bool) -> None:
    at = record.get("at", 0.0)
    if not works:
        known.active_s, known.since = known.active_until(at), None
    elif known.since is None:
        known.since, known._stretch = at, (known._stretch[0] + 1, known.active_s)


def _ack(known: JournalledPrint, record: Record) -> None:
    if known._seeking:  # the printer is proved to be the print's own
        known._seeking, known.heard = False, None
        known.end = known.stood = None
    known.done = record["done"]
    if "at" in record:
        _pace(known, record)


def _pace(known: JournalledPrint, record: Record) -> None:
    """Note how far the print has come; of too many moments keep every other one."""
    if known.since is None:
        return
    active_s, paces = known.active_until(record.get("at", 0.0)), known.paces
    number, begin_s = known._stretch  # at first lines are taken faster than they are made
    last_s = paces[-1][1] if paces else 0.0
    if active_s - max(begin_s, last_s) >= known._pace_every_s:
        paces.append((record["done"], active_s, number))
        if len(paces) > _MAX_PACES:
            del paces[1::2]
            known._pace_every_s *= 2


def _back(known: JournalledPrint, record: Record) -> None:
    """Lines above ``n`` weren't taken: what was in them goes again, perhaps under other numbers."""
    known.done = record["done"]
    known.made = min(known.made, known.done)
    last = record.get("n", math.inf)
    known.controls = {n: text for n, text in known.controls.items() if n <= last}


def _control(known: JournalledPrint, record: Record) -> None:
    """A control command has a number; the count of a new syringe may have got another one."""
    number, command = record["n"], record["command"]
    known.controls[number] = command
    counted = known.syringe
    if counted and counted["command"] == command and counted["n"] not in known.controls:
        known.syringe = {**counted, "n": number}


def _alarm(known: JournalledPrint, record: Record) -> None:
    known.last_alarm = str(record.get("text", ""))
    known.alarms.append(known.last_alarm)
    known._first_alarms.append(known.last_alarm)
    known.alarm_times.append(float(record.get("at", 0.0)))


def _repeated(known: JournalledPrint, record: Record) -> None:
    """An alarm came again: it says how often, and its last words."""
    known.last_alarm, first = times_words(record), known._first_alarms
    if record["first"] in first:
        index = len(first) - 1 - first[::-1].index(record["first"])
        known.alarms[index] = known.last_alarm


def times_words(record: Record) -> str:
    """Return the last words of an alarm that came again, and how often it did."""
    return f"{record.get('text', '')} ({record.get('times', '?')} times)"


def _checkpoint(known: JournalledPrint, record: Record) -> None:
    known.checkpoint = record
    _pace(known, record)
    if record.get("agrees") and record.get("mark"):
        known.checkpoints.append(record)
        known.made = record["done"] if record.get("stands") else known.made


def _left(known: JournalledPrint, record: Record) -> None:
    """The needle leaves the job's place, perhaps for another one."""
    known.left, known.park, known.in_ink = dict(record["place"]), None, False
    if record.get("park"):
        x, y, z = map(float, record["park"])
        known.park = x, y, z


def _firmware(known: JournalledPrint, record: Record) -> None:
    known.capabilities = dict(record["capabilities"])


def _settings(known: JournalledPrint, record: Record) -> None:
    known.settings = known.settings or dict(record["told"])


def _frame(known: JournalledPrint, record: Record) -> None:
    known.frame = {"told": record["told"], "offset": record["offset"]}


def _wanted(known: JournalledPrint, record: Record) -> None:
    known.wanted = record if record["after"] else None


def _reload(known: JournalledPrint, record: Record) -> None:
    known.reload, known.syringe, known.wanted = record, None, None


def _syringe(known: JournalledPrint, record: Record) -> None:
    known.syringe = record
    _plan(known, record)
    used, capacity = float(record["plunger_mm"]), float(record.get("capacity_mm", 0.0))
    known.filled.pop(record.get("head"), None)
    known.filled[record.get("head")] = Filling(
        record["done"], used, capacity, str(record.get("name", ""))
    )


def _plan(known: JournalledPrint, record: Record) -> None:
    """Changes of syringe are planned anew."""
    if "reload_at" in record:
        known.reload_at = tuple(record["reload_at"])
        known.reload_heads = tuple(record.get("reload_heads", ()))


def _looked(known: JournalledPrint, record: Record) -> None:
    known.looked.append(record)
    known.look = None


def _insert(known: JournalledPrint, record: Record) -> None:
    known.inserts.append(Insert.from_record(record))
    _plan(known, record)


def _end(known: JournalledPrint, record: Record) -> None:
    _count_time(known, record, works=False)
    if known._seeking:  # this attempt learned nothing of the lines
        record = {**(known.end or {}), **record, "done": known.done}
    known.end, known.over = record, True
    known.state, known.done = LinkState(record["state"]), record.get("done", known.done)
    known.message = record.get("message", "")


def _host(known: JournalledPrint, record: Record) -> None:
    if "file" in record:
        known.hosted = (record["do"], record["file"])


def _keep(name: str) -> Callable[[JournalledPrint, Record], None]:
    return lambda known, record: setattr(known, name, record)


_BY_SORT: Final[dict[str, Callable[[JournalledPrint, Record], None]]] = {
    "job": _job,
    "state": _state,
    "ack": _ack,
    "back": _back,
    "control": _control,
    "alarm": _alarm,
    "repeated": _repeated,
    "checkpoint": _checkpoint,
    "left": _left,
    "firmware": _firmware,
    "settings": _settings,
    "heat": _keep("heat"),
    "frame": _frame,
    "wanted": _wanted,
    "reload": _reload,
    "syringe": _syringe,
    "look": _keep("look"),
    "looked": _looked,
    "insert": _insert,
    "stood": _keep("stood"),
    "host": _host,
    "end": _end,
}
