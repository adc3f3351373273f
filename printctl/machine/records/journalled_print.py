"""Read a print's state from its journal: lines taken, checkpoints, alarms, syringe, stop place."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from printctl.machine.errors import JournalError
from printctl.machine.job.job import Insert
from printctl.machine.job.marks import Position
from printctl.machine.job.syringes import Filling
from printctl.machine.records.journal import RESERVE, Record, bytes_in, print_id, read_records
from printctl.machine.records.states import EARLY, LinkState


@dataclass
class JournalledPrint:
    """What a journal says about its print.

    Attributes
    ----------
    job : dict
        The last job record, with the print's ``id``; empty when even that is lost.
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
    filled : dict of (int or None) to Filling
        What was put in at changes of syringe, by head.
    inserts : list of Insert
        Lines that were put into the job, in order.
    look : dict or None
        A look that was begun, and that nobody has decided.
    looked : list of dict
        Those that were decided, in order.
    park : tuple of float or None, mm
        Where the needle was led for a look after which the print hasn't gone on.
    stood : dict or None
        Where in the job the printer stood after a stop; None in journals of before, and where
        nobody knows.
    heard : float or None, s since 1970
        Last word of the print before attempts to go on that didn't find the printer; None for none.
    end : dict or None
        The end record; None when the link process died first.
    damaged : int
        Lines with a wrong checksum, a torn last one included.
    gaps : int
        Those of them after which the same link process wrote on: no torn ends, but records that
        are missing, so that lines can't be counted.
    cut_short : bool
        Whether the disk was full, and the print's end isn't there.
    written_s : float, s since 1970
        Last word of the print, attempts that didn't find the printer aside.
    in_ink : bool
        Whether the needle stood at the job's place then.
    stopping : bool
        Whether it had begun to end the print: needle up, heaters perhaps off.
    settings : dict of str to str
        Settings of the firmware before the job's first line, by code: commands that set them.
    heat : Record
        Heaters' targets as the print had set them after so many lines; empty for none.
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
    filled: dict[int | None, Filling] = field(default_factory=dict)
    inserts: list[Insert] = field(default_factory=list)
    look: Record | None = None
    looked: list[Record] = field(default_factory=list)
    park: tuple[float, float, float] | None = None
    stood: Record | None = None
    heard: float | None = None
    end: Record | None = None
    damaged: int = 0
    gaps: int = 0
    cut_short: bool = False
    written_s: float = 0.0
    in_ink: bool = False
    stopping: bool = False
    settings: dict[str, str] = field(default_factory=dict)
    heat: Record = field(default_factory=dict)
    frame: Record = field(default_factory=dict)
    _torn: bool = False
    _seeking: bool = False
    """Going on with a printer that isn't proved yet to be the print's own: what is known stays."""

    @property
    def print_id(self) -> str:
        """Identity of the print."""
        return print_id(self.job)

    @property
    def total(self) -> int:
        """Command lines in the job, with what was put in."""
        inserted = sum(len(one.lines) for one in self.inserts)
        return int(self.job.get("lines", 0)) + inserted

    @property
    def positions(self) -> tuple[Position, ...]:
        """Where inserts stand in the grown job, and how many lines each has."""
        return tuple((one.after, len(one.lines)) for one in self.inserts)

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


def read_journal(path: Path) -> JournalledPrint:
    """Read a journal up to its last intact record.

    Raises
    ------
    JournalError
        When there is no such file.
    """
    try:
        history = replay(read_records(path))
        history.written_s = history.heard or path.stat().st_mtime
    except OSError as exc:
        raise JournalError(f"journal {path} can't be read: {exc.strerror}") from exc
    reserve = path.with_name(RESERVE)
    history.cut_short = history.end is None and reserve.exists() and not bytes_in(reserve)
    return history


def replay(records: Iterable[Record | None]) -> JournalledPrint:
    """Return what a journal's records say, None standing for a damaged one."""
    history = JournalledPrint()
    for record in records:
        _apply(history, record)
    return history


def _apply(history: JournalledPrint, record: Record | None) -> None:
    sort = record["t"] if record and "t" in record else None
    if record is None or sort is None:
        history.damaged, history._torn = history.damaged + 1, True
        return
    if history._torn:  # a process that begins, or whose disk was full for a while, may go on there
        history._torn, begins = False, record.get("state") == LinkState.CONNECTING
        history.gaps += not (sort in ("job", "end") or begins)
    if sort == "ack" and history._seeking:
        history._seeking, history.heard = False, None
        history.end = history.stood = None
    if sort == "job":
        begun = bool(history.job)
        history.job = {**record, "id": print_id(history.job if begun else record)}
        history._seeking, history.heard = begun, history.heard or record.get("heard")
    elif sort == "state" and history._seeking and record["state"] in EARLY:
        pass
    elif sort == "state":
        history.state = LinkState(record["state"])
        history.stopping |= history.state is LinkState.STOPPING
        history.in_ink &= not history.stopping
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
        _left(history, record)
    elif sort == "settings":
        history.settings = history.settings or dict(record["told"])
    elif sort == "heat":
        history.heat = record
    elif sort == "frame":
        history.frame = {"told": record["told"], "offset": record["offset"]}
    elif sort == "wanted":
        history.wanted = record if record["after"] else None
    elif sort == "reload":
        history.reload, history.syringe, history.wanted = record, None, None
    elif sort == "syringe":
        history.syringe = record
        _plan(history, record)
        used, capacity = float(record["plunger_mm"]), float(record.get("capacity_mm", 0.0))
        history.filled[record.get("head")] = Filling(
            record["done"], used, capacity, str(record.get("name", ""))
        )
    elif sort == "look":
        history.look = record
    elif sort == "looked":
        history.looked.append(record)
        history.look = None
    elif sort == "insert":
        history.inserts.append(Insert.from_record(record))
        _plan(history, record)
    elif sort == "stood":
        history.stood = record
    elif sort == "end":
        if history._seeking:  # this attempt learned nothing of the lines
            record = {**(history.end or {}), **record, "done": history.done}
        history.end = record
        history.state, history.done = LinkState(record["state"]), record["done"]
        history.message = record.get("message", "")


def _left(history: JournalledPrint, record: Record) -> None:
    """The needle leaves the job's place, perhaps for another one."""
    history.left, history.park, history.in_ink = dict(record["place"]), None, False
    if record.get("park"):
        x, y, z = map(float, record["park"])
        history.park = x, y, z


def _plan(history: JournalledPrint, record: Record) -> None:
    """Changes of syringe are planned anew."""
    history.reload_at = tuple(record["reload_at"])
    history.reload_heads = tuple(record.get("reload_heads", ()))


def _repeated(history: JournalledPrint, record: Record) -> None:
    """An alarm came again: it says how often, and its last words."""
    first = history._first_alarms
    if record["first"] in first:
        index = len(first) - 1 - first[::-1].index(record["first"])
        history.alarms[index] = times_words(record)


def times_words(record: Record) -> str:
    """Return the last words of an alarm that came again, and how often it did."""
    return f"{record.get('text', '')} ({record.get('times', '?')} times)"


def _back(history: JournalledPrint, record: Record) -> None:
    """Lines above ``n`` weren't taken: what was in them goes again, perhaps under other numbers."""
    history.done = record["done"]
    history.made = min(history.made, history.done)
    last = record.get("n", math.inf)
    history.controls = {n: text for n, text in history.controls.items() if n <= last}


def _control(history: JournalledPrint, record: Record) -> None:
    """A control command has a number; the count of a new syringe may have got another one."""
    number, command = record["n"], record["command"]
    history.controls[number] = command
    counted = history.syringe
    if counted and counted["command"] == command and counted["n"] not in history.controls:
        history.syringe = {**counted, "n": number}


def _printing(history: JournalledPrint) -> None:
    """The print goes on: whatever change of syringe there was is made."""
    history.begun, history.park, history.in_ink = True, None, True
    if history.reload is not None:
        history.reloaded = history.reload["done"]
    history.reload = history.syringe = None
