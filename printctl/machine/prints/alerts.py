"""Explain a print's alarm or early end to who stands beside it: what, consequence, remedy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal

import yaml

from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.errors import HandshakeError, PortLost
from printctl.machine.network.file_print import HOST_ENDED
from printctl.machine.records.states import LinkState, Status

Tone = Literal["info", "warn", "bad"]
Sentences = tuple[str, str, str]

_TABLE: Final = Path(__file__).with_name("alarms.yaml")
_LIFT: Final = (
    "Check where the needle is, and lift it by hand if it is in the part. Then reconnect the "
    "printer on the Printer page."
)
_NOT_BEGUN: Final = "The printer has acknowledged no line of the job."
_POSITION_LOST: Final = (
    "This print is over. The printer has lost its position, and its heaters are off."
)


_GOES_ON: Final = re.compile(
    r"; the print continues(?=\.)|^The print continues(?:; | unless [^.]*\.)"
)
"""What an alarm means of a print only until its end."""


@dataclass(frozen=True)
class Alert:
    """What of a print somebody must know: what happened, what it means, what to do.

    ``means`` and ``remedy`` may be empty; ``detail`` says the same with codes and places.
    """

    what: str
    means: str = ""
    remedy: str = ""
    detail: str = ""
    tone: Tone = "warn"


def alert_of(status: Status, last_alarm: str, may_go_on: bool) -> Alert | None:
    """Return the alert of a print: its end where that wasn't as meant, else its last alarm.

    ``last_alarm`` is as journalled; ``may_go_on``: whether an interrupted print can be resumed.
    """
    if status.ended and status.state is not LinkState.DONE:
        return _of_end(status, may_go_on)
    if status.state is LinkState.DONE and not status.position_known:
        return Alert(*_alarm("another program"), status.message)
    if status.state is LinkState.DONE and not status.proved:
        return Alert(*_alarm(status.message), status.message)
    if not status.alarms:
        return None
    what, means, remedy = _alarm(last_alarm)
    if status.ended:
        means = _GOES_ON.sub("", means)
        means = means[:1].upper() + means[1:]
    return Alert(what, means, remedy, last_alarm)


def _of_end(status: Status, may_go_on: bool) -> Alert:
    detail, known = status.message, status.position_known
    if status.state is LinkState.KILLED:
        return Alert(*_killed(detail), detail, "bad")
    if status.state is LinkState.STOPPED:
        what = "The print was cancelled"
        if "dead-man" in detail:
            what = "The print was cancelled: no operator confirmed presence"
        means, remedy = "The plunger was relieved and the needle lifted straight up.", ""
        if HOST_ENDED in detail:
            means = (
                "The host cancelled it with its own script; the plunger may still be under "
                "pressure."
            )
            remedy = "Check the needle before anything moves."
        elif not known:
            means, remedy = "The needle position is uncertain.", _LIFT
        elif not status.lines_done:
            means = _NOT_BEGUN
        return Alert(what, means, remedy, detail, "info")
    if status.state is LinkState.GIVEN_UP:
        return Alert("The print was given up", "It can't be continued.", "", detail, "info")
    if status.state is LinkState.INTERRUPTED:
        what = "The program that controlled the printer ended during the print"
        means = "The printer executes its queued moves, then stops; its heaters "
        means += "stay as set."
        remedy = "It can't continue from here: Recover plans the rest as a separate job."
        if may_go_on:
            remedy = (
                "If the printer stayed powered and the needle wasn't moved: Go on. Otherwise: "
                "Recover."
            )
    elif status.error == PortLost.__name__:
        what = "The connection to the printer was lost"
        means = "If powered, it executes its queued moves; its heaters stay as set."
        remedy = "Check its power and its cable. " + _LIFT
    elif detail.startswith("unknown"):
        what = "The state of the printer is unknown: its network host doesn't report it"
        means, remedy = (
            ("The print may be running, or not have started."),
            "Check the printer. " + _LIFT,
        )
    elif status.state is LinkState.POSITION_UNKNOWN or not known:
        what = "The printer's position is uncertain"
        means, remedy = (
            ("The print was ended, so that nothing is printed in the wrong position."),
            _LIFT,
        )
    elif status.error == HandshakeError.__name__:
        what, means = "The print couldn't start", _NOT_BEGUN
        remedy = "See the details for the cause, then print again."
    else:
        what = "A fault ended the print"
        means = "The print was ended; the plunger was relieved and the needle lifted."
        means = means if status.lines_done else _NOT_BEGUN
        remedy = "See the details for the cause; inspect the part before anything moves."
    return Alert(what, means, remedy, detail, "bad")


def _killed(detail: str) -> Sentences:
    if UNCONFIRMED in detail:
        what = "Emergency stop sent, but the printer hasn't confirmed that it halted"
        means = "It may still be moving, and its heaters may be on."
        return what, means, "Cut its power now. " + _LIFT
    by_user = detail.startswith(("emergency stop by", "killed by"))  # the latter in older journals
    if by_user and "itself" not in detail:
        return "The printer has halted after an emergency stop", _POSITION_LOST, _LIFT
    return "The printer halted itself", _POSITION_LOST, "Its own screen may say why. " + _LIFT


_UNUSUAL: Final = (
    "The printer reports something unusual",
    "The print continues unless stated otherwise above.",
    "Check the printer and the part; the details quote its message.",
)


@cache
def _alarms() -> list[tuple[str, Sentences]]:
    """Read patterns of alarms' texts, and what is said of each."""
    rows = yaml.safe_load(_TABLE.read_text(encoding="utf-8"))
    return [(one["pattern"], (one["what"], one["means"], one["remedy"])) for one in rows]


def _alarm(text: str) -> Sentences:
    return next((words for pattern, words in _alarms() if re.search(pattern, text)), _UNUSUAL)
