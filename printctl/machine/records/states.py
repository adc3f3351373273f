"""States of a print, and its status as clients see it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Final


class LinkState(StrEnum):
    """Where a print stands. The diagram is in ``docs/link_reference.md``."""

    CONNECTING = "connecting"
    CHECKING = "checking"
    PRINTING = "printing"
    PAUSING = "pausing"
    PAUSED = "paused"
    LOOKING = "looking"
    """Held as in a pause, until a client, or the operator, has decided on what is seen."""
    RESUMING = "resuming"
    STOPPING = "stopping"
    UNKNOWN = "unknown"
    """The network host that runs the file doesn't answer; the print may go on."""
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"
    KILLED = "killed"
    POSITION_UNKNOWN = "position_unknown"
    INTERRUPTED = "interrupted"
    """The process that spoke to the printer died: no end is in the journal. Never journalled."""
    GIVEN_UP = "given_up"
    """A person said that an interrupted print isn't to be gone on with."""


ENDED: Final = frozenset(
    {LinkState.DONE, LinkState.STOPPED, LinkState.FAILED, LinkState.KILLED}
    | {LinkState.POSITION_UNKNOWN, LinkState.INTERRUPTED, LinkState.GIVEN_UP}
)
"""States that nothing follows."""
EARLY: Final = frozenset({LinkState.CONNECTING, LinkState.CHECKING})
"""States in which the printer hasn't got the job's first line."""
_STATE_WORDS: Final = {"stopping": "cancelling", "stopped": "cancelled", "killed": "halted"}


def state_words(state: str) -> str:
    """Return a state as it is shown: ``position unknown``."""
    return _STATE_WORDS.get(state, state).replace("_", " ")


@dataclass(frozen=True)
class Status:
    """A print as its clients see it, and how it ended.

    Attributes
    ----------
    lines_done, lines_total : int
        Command lines acknowledged by the printer, and in the job.
    file_line : int
        One-based line of the job file that was acknowledged last; 0 before the first.
    message : str
        What happened last, for the user.
    line_errors : int
        Lines that had to be sent again.
    alarms : int
        Faults and other alarms journalled so far.
    position_known : bool
        Whether the printer still knows where its needle is.
    error : str
        Name of the error's class (`printctl.machine.errors`) when the print failed by one.
    waits_for : str
        What will hold the print at a mark ("pause after layer", "reload"), or what a paused one
        needs before it can be resumed ("syringe"; of several heads "syringe 1"); empty for nothing.
    deadman_left_s : float or None, s
        Time in which somebody must confirm (`printctl alive`), all of it while the print doesn't
        go on; None for an attended print.
    readings : tuple of str
        Last readings of what the printer's profile has watched, with their limits.
    lines_executed : int
        Lines done whose motion has certainly been made; the last ones may still be ahead in the
        firmware's planner. Equal to `lines_done` once the printer stands still.
    look : dict or None
        The look that the print is held for (`LookBook.told`): ``number``, ``mark``, ``layer``,
        ``done``, ``since``, ``limit_s``, ``inserted``, ``insert_sha256``, ``decision``.
    inserted : tuple of (int, int)
        Lines before each insert so far, in the grown job, and how many it has.
    """

    state: LinkState
    lines_done: int = 0
    lines_total: int = 0
    file_line: int = 0
    message: str = ""
    line_errors: int = 0
    alarms: int = 0
    position_known: bool = True
    error: str = ""
    waits_for: str = ""
    deadman_left_s: float | None = None
    readings: tuple[str, ...] = ()
    lines_executed: int = 0
    look: dict[str, Any] | None = None
    inserted: tuple[tuple[int, int], ...] = ()

    @property
    def ended(self) -> bool:
        """Whether the print is over."""
        return self.state in ENDED

    @property
    def proved(self) -> bool:
        """Whether it is done, and neither other programs nor the printer's panel changed it."""
        return self.state is LinkState.DONE and self.position_known and not self.error

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)

    def end_record(self) -> dict[str, Any]:
        """Return the values of the journal's end record."""
        keys = ("state", "message", "error", "position_known")
        return {"done": self.lines_done, **{key: getattr(self, key) for key in keys}}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Status:
        """Read `to_dict`; keys of later versions are ignored."""
        known = {name: data[name] for name in Status.__dataclass_fields__ if name in data}
        lists = {
            "readings": tuple(known.get("readings", ())),
            "inserted": tuple((after, count) for after, count in known.get("inserted", ())),
        }
        return Status(**{**known, "state": LinkState(known["state"]), **lists})


class PrintEnded(Exception):  # noqa: N818
    """The end of a print, raised where it is found.

    Attributes
    ----------
    known : bool
        Whether the printer's position is known.
    error : str
        Name of the `LinkError` behind it; empty for none.
    """

    def __init__(self, state: LinkState, message: str, known: bool = True, error: str = "") -> None:
        super().__init__(message)
        self.state, self.message, self.known, self.error = state, message, known, error
