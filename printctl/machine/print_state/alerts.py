"""Explain a print's alarm or early end to who stands beside it: what, consequence, remedy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

from printctl.machine.link.errors import PortLost
from printctl.machine.link.kill import UNCONFIRMED
from printctl.machine.link.states import LinkState, Status

Tone = Literal["info", "warn", "bad"]
Sentences = tuple[str, str, str]

_LIFT: Final = (
    "See where the needle is, and lift it by hand if it stands in the part. Then connect the "
    "printer again on the page Printer."
)
_POSITION_LOST: Final = (
    "This print is over. The printer doesn't know where its needle is any more, and its heaters "
    "are off."
)


@dataclass(frozen=True)
class Alert:
    """The one thing of a print that somebody must know.

    Attributes
    ----------
    what : str
        What happened.
    means : str
        What it means for the print; empty where that is clear.
    remedy : str
        What to do; empty for nothing.
    detail : str
        The same in the words of the link, with codes and places.
    tone : "info", "warn" or "bad"
    """

    what: str
    means: str = ""
    remedy: str = ""
    detail: str = ""
    tone: Tone = "warn"


def alert_of(status: Status, last_alarm: str, may_go_on: bool) -> Alert | None:
    """Return the alert of a print: its end where that wasn't as meant, else its last alarm.

    Parameters
    ----------
    status : Status
    last_alarm : str
        As it was journalled.
    may_go_on : bool
        Whether an interrupted print can be gone on with.
    """
    if status.ended and status.state is not LinkState.DONE:
        return _of_end(status, may_go_on)
    if status.state is LinkState.DONE and not status.position_known:
        return Alert(*_OTHERS, status.message)
    if not status.alarms:
        return None
    what, means, remedy = next(
        (words for pattern, words in _ALARMS if re.search(pattern, last_alarm)), _UNUSUAL
    )
    return Alert(what, means, remedy, last_alarm)


def _of_end(status: Status, may_go_on: bool) -> Alert:
    detail, known = status.message, status.position_known
    if status.state is LinkState.KILLED:
        return Alert(*_killed(detail), detail, "bad")
    if status.state is LinkState.STOPPED:
        what = "The print was stopped"
        if "stopped by the user" in detail:
            what = "The print was cancelled"
        elif "dead-man" in detail:
            what = "The print was stopped: nobody confirmed to be there"
        means = "The plunger was relieved and the needle lifted straight up."
        return Alert(what, *((means, "") if known else (_POSITION_LOST, _LIFT)), detail, "info")
    if status.state is LinkState.GIVEN_UP:
        return Alert("The print was given up", "It can't be gone on with.", "", detail, "info")
    if status.state is LinkState.INTERRUPTED:
        means = "The printer has made the moves that it held, and stands still in the part."
        remedy = (
            "If it kept its power and nobody moved the needle: Go on. Else: Recover."
            if may_go_on
            else "It can't go on from here by itself: Recover plans the rest as a job of its own."
        )
        what = "The program that spoke to the printer ended in the middle of the print"
        return Alert(what, means, remedy, detail, "bad")
    if status.error == PortLost.__name__:
        what = "The connection to the printer was lost"
        means = "It makes the moves that it still holds, then stands still in the part."
        remedy = "See its power and its cable. " + _LIFT
        return Alert(what, means, remedy, detail, "bad")
    if status.state is LinkState.POSITION_UNKNOWN or not known:
        what = "The printer doesn't know for sure where its needle is"
        means = "The print was ended, so that nothing is written beside its place."
        return Alert(what, means, _LIFT, detail, "bad")
    means = "The print was ended; the plunger was relieved and the needle lifted."
    remedy = "See the details for the cause; look at the part before anything moves."
    return Alert("A fault ended the print", means, remedy, detail, "bad")


def _killed(detail: str) -> Sentences:
    if UNCONFIRMED in detail:
        what = "STOP was sent, and the printer hasn't confirmed that it halted"
        return what, _POSITION_LOST, "Cut its power now. " + _LIFT
    if detail.startswith("killed by the user") and "itself" not in detail:
        return "STOP has halted the printer", _POSITION_LOST, _LIFT
    return "The printer halted itself", _POSITION_LOST, "Its own screen may say why. " + _LIFT


_LOOK: Final = "Look at the part there."
_UNUSUAL: Final = (
    "The printer reports something unusual",
    "The print goes on unless it says otherwise above.",
    "Look at the printer and at the part; the details have its own words.",
)
_OTHERS: Final = (
    "Another program uses the printer's connection",
    "Its commands may have come between the print's, and may have touched the part.",
    "Close that program (a slicer, a terminal), and look at the part.",
)
_ALARMS: Final[tuple[tuple[str, Sentences], ...]] = (
    (
        r"is set to .* °C",
        (
            "A heater was set to another temperature than the print's",
            "Cells and ink may be warmer or colder than planned.",
            "See the temperatures, and that no other program controls the printer.",
        ),
    ),
    (
        r"answers of the printer were missing",
        (
            "Some of the printer's answers were missing or cut",
            "The cable may be loose, or another program may use the connection; the print goes on.",
            "See the cable, and that no slicer or terminal is connected to the printer.",
        ),
    ),
    (r"another program|count of lines became", _OTHERS),
    (
        r"dead-man",
        (
            "Nobody has confirmed to be there",
            "The print is held with the needle raised.",
            "Look at the part, then resume.",
        ),
    ),
    (
        r"ink stood still",
        (
            "The needle stood still for a moment while it wrote",
            "There may be a blob or a gap at that place; the print goes on.",
            _LOOK,
        ),
    ),
    (
        r"slipped through its checksum",
        (
            "One garbled command may have moved the needle wrongly",
            "The position was compared since and is right; the print goes on.",
            _LOOK,
        ),
    ),
    (
        r"line errors|weren't taken after all",
        (
            "The connection to the printer is disturbed",
            "Lost commands were sent again; nothing was printed twice.",
            "See that the cable sits well and away from motors and pumps.",
        ),
    ),
    (
        r"no usable answer|sends no busy messages|answers to .* can't be read",
        (
            "The printer answers late",
            "The print waits for it, and ends by itself if nothing comes.",
            "See its power and its cable.",
        ),
    ),
    (
        r"the printer refused",
        (
            "The printer refused a command of the job",
            "That line wasn't made.",
            "See the details; look at the part.",
        ),
    ),
    (
        r"the printer asks|waits for somebody to press",
        (
            "The printer waits for somebody at its own screen",
            "The print stands until then.",
            "Answer there, or cancel the print.",
        ),
    ),
    (
        r"halted itself",
        ("The printer halted itself", "The print ends.", "Its own screen may say why."),
    ),
    (
        r"valve stood open",
        (
            "The ink's valve stood open while nothing spoke to the printer",
            "Ink may have run out there.",
            _LOOK,
        ),
    ),
    (
        r"decided to",
        (
            "An inspection of the print has decided",
            "Its picture is among the last looks.",
            "See what was found there.",
        ),
    ),
    (
        r"a heater is on",
        (
            "A heater stays on after the print",
            "The printer's own switch-off stays as the job set it.",
            "Switch the heater off when you are done.",
        ),
    ),
    (
        r"park_mm",
        (
            "The needle waits above the part, not beside it",
            "Ink may drip onto the part in a pause.",
            "Keep pauses short.",
        ),
    ),
    (
        r"wire log|can't be written|disk",
        (
            "The disk can't take the record of the print",
            "The print goes on; part of its record may be missing.",
            "Free some space.",
        ),
    ),
    (
        r"\(printer: watch\)",
        (
            "A watched reading is above its limit",
            "The print ends where it stays so.",
            "See the readings on the page Printer.",
        ),
    ),
    (
        r"where the job says",
        (
            "The needle wasn't where the job expected it",
            "What was written just before may be displaced.",
            _LOOK,
        ),
    ),
)
"""Alarms by what their text has in it, the first that fits; see the callers of `Logbook.alarm`."""
