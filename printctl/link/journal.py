r"""The journal: what is true about a print, in a file that only grows.

One record a line: ``<crc32 of the JSON, 8 hex digits> <JSON>\n``. A record is one ``write`` to a
file opened for appending, so a killed process leaves at most one torn line at the end, which the
reader drops and reports. Record sorts (key ``t``):

========== =====================================================================================
job        file name, sha256, lines, profile, port, pid, who, host, wall-clock start: first; again
           on going on; ``accepted``: failed checks that the user told to print with all the same
state      state, message
ack        ``done``: command lines known to be taken; never more than is true
back       ``done``, ``n``: lines that an ok which wasn't theirs had acknowledged are taken back, to
           the line of number ``n``; control records of what goes again follow
control    ``n``, ``command``: a line number about to be used for a control command
alarm      text
repeated   an alarm came again: ``first``: its first text, ``text``: its last, ``times``
checkpoint position read back (M114) after ``done`` command lines, ``agrees`` with the job's text?
           ``mark``: what ended there, where it was made at a mark; ``stands``: with the motors at
           rest, so that those lines were made
wanted     ``after``: the mark at which somebody wants the print held; empty once it is taken
           back; ``head``: of several, whose syringe
reload     a change of syringe begins after ``done`` lines; the plunger's count was ``e``; ``head``:
           of several, whose
syringe    ``n``, ``command``: the line about to call the new plunger's place the job's; what was
           put in; ``reload_at``, ``reload_heads``: where the next changes are due
left       the job's ``place`` that the needle leaves for a pause: after the host's death it tells
           what the job's own lines haven't
stood      after a stop: ``line``, ``begin_at``, ``certain`` as in `Stood`; ``done`` lines taken;
           ``dropped``: whether moves of theirs weren't made; ``place`` that the printer told
end        state, message, done, error, position_known: last; where the printer refused a line of
           the job: ``refused``, the lines before it, and ``made``, those of them surely made
========== =====================================================================================

job, state, alarm, checkpoint, left, wanted, reload, syringe, stood and end records also have
``at``, the wall-clock time, s since 1970.

What is durable: every record is in the kernel when `Journal.add` returns, so it survives the
death of the process (kill -9). Those with ``at`` are also forced to the disk, but for a checkpoint
that agrees and was made at no mark. That one and ack and control records are not, since forcing
the disk several times a second would stall the line, and after a loss of power the printer has
lost its position as well.

Room is kept back on the disk (``journal.reserve``), so that the end of a print that a full disk
ends can be written down. Emptied, it says that records may be missing at the journal's end.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printctl.link.errors import JournalError
from printctl.link.states import LinkState

Record = dict[str, Any]
RESERVE: Final = "journal.reserve"
RESERVE_BYTES: Final = 65_536
_DATED: Final = frozenset(
    {"job", "state", "alarm", "checkpoint", "left", "wanted", "reload", "syringe", "stood", "end"}
)


class Journal:
    """An append-only journal; any thread may add to it.

    Parameters
    ----------
    path : Path
        Made if absent; an existing one is gone on with (a torn tail is closed by a line end).
    reserve : bool
        Whether to keep room back on the disk until the print has ended.

    Raises
    ------
    JournalError
        When it can't be written.
    """

    def __init__(self, path: Path, reserve: bool = False) -> None:
        self.path = path
        self._lock, self._torn, self._ended = threading.Lock(), False, False
        self._reserve = path.with_name(RESERVE) if reserve else None
        try:
            if self._reserve is not None:
                _keep_room(self._reserve)
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            size = os.fstat(self._fd).st_size
            if size and _last_byte(path, size) != b"\n":
                os.write(self._fd, b"\n")
        except OSError as exc:
            raise JournalError(f"journal {path} can't be opened: {exc.strerror}") from exc

    def add(self, sort: str, **values: Any) -> None:
        """Append a record.

        Raises
        ------
        JournalError
            When it can't be written (disk full); the record isn't there then.
        """
        at = {"at": time.time()} if sort in _DATED else {}
        line = encode({"t": sort, **at, **values})
        passing = sort == "checkpoint" and values.get("agrees") and not values.get("mark")
        with self._lock:
            try:
                if self._torn:  # a part of the last record is there
                    line = b"\n" + line
                written = os.write(self._fd, line)
                self._torn = written != len(line) and (self._torn or written > 0)
                if written != len(line):
                    raise OSError("disk full")
                self._ended = sort == "end"
                if at and not passing:
                    os.fsync(self._fd)
            except OSError as exc:
                raise JournalError(
                    f"journal {self.path} can't be written: {exc}; free space on the disk"
                ) from exc

    def use_reserve(self) -> bool:
        """Free the room kept back, so that the record that didn't fit may be added once more.

        Returns
        -------
        bool
            False where there is none left.
        """
        with self._lock:
            if self._reserve is None or not _bytes_in(self._reserve):
                return False
            try:
                os.truncate(self._reserve, 0)
                if self._torn:
                    os.ftruncate(self._fd, _end_of_last_line(self.path))
            except OSError:
                return False
            self._torn = False
            return True

    def close(self) -> None:
        """Force everything to the disk, if it can, and let go of the file.

        Closing twice does no harm. The print is over: what the disk says now changes no outcome.
        """
        with self._lock:
            if self._fd >= 0:
                with contextlib.suppress(OSError):
                    os.fsync(self._fd)
                with contextlib.suppress(OSError):
                    os.close(self._fd)
                self._fd = -1
            if self._ended and self._reserve is not None:
                with contextlib.suppress(OSError):
                    self._reserve.unlink(missing_ok=True)


def _keep_room(reserve: Path) -> None:
    if _bytes_in(reserve) < RESERVE_BYTES:
        reserve.write_bytes(os.urandom(RESERVE_BYTES))  # no disk can make it smaller


def _bytes_in(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _end_of_last_line(path: Path) -> int:
    return path.read_bytes().rfind(b"\n") + 1


def _last_byte(path: Path, size: int) -> bytes:
    with path.open("rb") as handle:
        handle.seek(size - 1)
        return handle.read(1)


def encode(record: Record) -> bytes:
    """One record as a line."""
    text = json.dumps(record, separators=(",", ":"), ensure_ascii=True).encode()
    return b"%08x %b\n" % (zlib.crc32(text), text)


def decode(line: bytes) -> Record | None:
    """Read a line; None when its checksum is wrong."""
    crc, _, text = line.rstrip(b"\n").partition(b" ")
    try:
        record = json.loads(text) if crc == b"%08x" % zlib.crc32(text) else None
    except ValueError:
        return None
    return record if isinstance(record, dict) else None


def read_records(path: Path) -> Iterator[Record | None]:
    """Give the records in order, None for each damaged line."""
    with path.open("rb") as handle:
        for line in handle:
            yield decode(line) if line.endswith(b"\n") else None


@dataclass
class History:
    """What a journal says about its print.

    Attributes
    ----------
    job : dict
        The job record; empty when even that is lost.
    state : LinkState
        Last one recorded.
    begun : bool
        Whether the handshake was through and job lines may have been sent.
    message : str
    done : int
        Command lines known to be taken: at least so many, perhaps `slack` more.
    controls : dict of int to str
        Line numbers used for control commands.
    alarms : list of str
    checkpoint : dict or None
        The last one.
    checkpoints : list of dict
        Those at marks that agreed with the job, in order.
    made : int
        Command lines that were made for certain when the motors last stood.
    left : dict of str to float
        The job's place that the needle last left for a pause, by `Modal`'s names; empty for none.
    wanted : dict or None
        A mark at which somebody wants the print held, which it wasn't yet.
    reload, syringe : dict or None
        Records of a change of syringe after which the print hasn't gone on.
    reloaded : int
        Command lines after which the last change was made; -1 for none.
    reload_at : tuple of int or None
        Where the next changes are due, since the last one.
    reload_heads : tuple of int
        Of several heads, whose.
    stood : dict or None
        Where in the job the printer stood after a stop; None in journals of before, and where
        nobody knows.
    end : dict or None
        The end record; None when the link process died first.
    damaged : int
        Lines with a wrong checksum, a torn last one included.
    gaps : int
        Those of them after which the same link process wrote on: no torn ends, but records that
        are missing, so that lines can't be counted.
    cut_short : bool
        Whether the disk was full, and the print's end isn't there.
    stopping : bool
        Whether it had begun to end the print: needle up, heaters perhaps off.
    settings : dict of str to str
        Settings of the firmware before the job's first line, by code: commands that set them.
    frame : dict of str to dict
        What `FrameCheck.begin` noted before the job's first line; empty where it couldn't.
    """

    job: Record = field(default_factory=dict)
    state: LinkState = LinkState.CONNECTING
    begun: bool = False
    message: str = ""
    done: int = 0
    controls: dict[int, str] = field(default_factory=dict)
    alarms: list[str] = field(default_factory=list)
    _first_alarms: list[str] = field(default_factory=list, repr=False)
    checkpoint: Record | None = None
    checkpoints: list[Record] = field(default_factory=list)
    made: int = 0
    left: dict[str, float] = field(default_factory=dict)
    wanted: Record | None = None
    reload: Record | None = None
    syringe: Record | None = None
    reloaded: int = -1
    reload_at: tuple[int, ...] | None = None
    reload_heads: tuple[int, ...] = ()
    stood: Record | None = None
    end: Record | None = None
    damaged: int = 0
    gaps: int = 0
    cut_short: bool = False
    stopping: bool = False
    settings: dict[str, str] = field(default_factory=dict)
    frame: Record = field(default_factory=dict)
    _torn: bool = False

    @property
    def total(self) -> int:
        """Command lines in the job."""
        return int(self.job.get("lines", 0))

    def job_line(self, number: int) -> int:
        """Job lines taken when the printer's last line number is ``number``."""
        return number - sum(1 for control in self.controls if control <= number)

    def changing(self, number: int) -> bool:
        """Whether a change of syringe is open: begun, and the plunger not yet counted anew.

        Parameters
        ----------
        number : int
            The printer's last line: a line with a number above it was written down, not taken.
        """
        if self.reload is None:
            return False
        counted = self.syringe
        if counted is None or counted["n"] > number:
            return True
        return self.controls.get(counted["n"]) != counted["command"]


def read_journal(path: Path) -> History:
    """Read a journal up to its last intact record.

    Raises
    ------
    JournalError
        When there is no such file.
    """
    history = History()
    try:
        for record in read_records(path):
            _apply(history, record)
    except OSError as exc:
        raise JournalError(f"journal {path} can't be read: {exc.strerror}") from exc
    reserve = path.with_name(RESERVE)
    history.cut_short = history.end is None and reserve.exists() and not _bytes_in(reserve)
    return history


def _apply(history: History, record: Record | None) -> None:
    sort = record["t"] if record and "t" in record else None
    if record is None or sort is None:
        history.damaged, history._torn = history.damaged + 1, True
        return
    if history._torn:  # a process that begins, or whose disk was full for a while, may go on there
        history._torn, begins = False, record.get("state") == LinkState.CONNECTING
        history.gaps += not (sort in ("job", "end") or begins)
    if sort == "job":
        history.job, history.end, history.stood = record, None, None
    elif sort == "state":
        history.state = LinkState(record["state"])
        history.stopping |= history.state is LinkState.STOPPING
        if history.state is LinkState.PAUSED:
            history.wanted = None
        if history.state is LinkState.PRINTING:
            _printing(history)
        history.message = record.get("message", "")
    elif sort == "ack":
        history.done = record["done"]
    elif sort == "back":
        _back(history, record)
    elif sort == "control":
        _control(history, record)
    elif sort == "alarm":
        history.alarms.append(record["text"])
        history._first_alarms.append(record["text"])
    elif sort == "repeated":
        _repeated(history, record)
    elif sort == "checkpoint":
        history.checkpoint = record
        if record["agrees"] and record.get("mark"):
            history.checkpoints.append(record)
            history.made = record["done"] if record.get("stands") else history.made
    elif sort == "left":
        history.left = dict(record["place"])
    elif sort == "settings":
        history.settings = history.settings or dict(record["told"])
    elif sort == "frame":
        history.frame = {"told": record["told"], "offset": record["offset"]}
    elif sort == "wanted":
        history.wanted = record if record["after"] else None
    elif sort == "reload":
        history.reload, history.syringe, history.wanted = record, None, None
    elif sort == "syringe":
        history.syringe, history.reload_at = record, tuple(record["reload_at"])
        history.reload_heads = tuple(record.get("reload_heads", ()))
    elif sort == "stood":
        history.stood = record
    elif sort == "end":
        history.end = record
        history.state, history.done = LinkState(record["state"]), record["done"]
        history.message = record.get("message", "")


def _repeated(history: History, record: Record) -> None:
    """An alarm came again: it says how often, and its last words."""
    first = history._first_alarms
    if record["first"] in first:
        index = len(first) - 1 - first[::-1].index(record["first"])
        history.alarms[index] = times_words(record)


def times_words(record: Record) -> str:
    """Return the last words of an alarm that came again, and how often it did."""
    return f"{record.get('text', '')} ({record.get('times', '?')} times)"


def _back(history: History, record: Record) -> None:
    """Lines above ``n`` weren't taken: what was in them goes again, perhaps under other numbers."""
    history.done = record["done"]
    history.made = min(history.made, history.done)
    last = record.get("n", math.inf)
    history.controls = {n: text for n, text in history.controls.items() if n <= last}


def _control(history: History, record: Record) -> None:
    """A control command has a number; the count of a new syringe may have got another one."""
    number, command = record["n"], record["command"]
    history.controls[number] = command
    counted = history.syringe
    if counted and counted["command"] == command and counted["n"] not in history.controls:
        history.syringe = {**counted, "n": number}


def _printing(history: History) -> None:
    """The print goes on: whatever change of syringe there was is made."""
    history.begun = True
    if history.reload is not None:
        history.reloaded = history.reload["done"]
    history.reload = history.syringe = None
