"""Requests of a machine process: values, modes in which each is allowed, what it does to a print.

Each has ``by`` with it, which is written down: ``who`` requests it and ``from`` where.
A request's values are read once, here; what they mean for the printer is checked where it is done.
While a print goes on ``command`` goes to it, between two lines; else to the standing printer.

``resume``: with ``change``, the fields of `NewSyringe`, or ``unchanged``; with ``unobserved`` a
look that failed isn't made again; it is answered by ``{"event": "resumed"}`` once the print goes
on, or refused. While a print is looking (``look`` of its status says which):
``insert`` is answered by ``{"event": "inserted", "look", "after", "count", "sha256", "flow"}`` once
it is in the journal, ``look_done`` by ``{"event": "looked", "look", "decision", "why"}``. Sending
one of them again gives the same answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum, auto
from typing import Any, Final

from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import Refused
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.actor import read_actor

Values = dict[str, Any]
Reply = Callable[[dict[str, Any]], None]
Read = Callable[[Any], Any]
"""Return a value of a JSON value, or raise ValueError with what it must be."""


def _is(right: Callable[[Any], bool], wanted: str) -> Read:
    def read(value: Any) -> Any:
        if not right(value):
            raise ValueError(wanted)
        return value

    return read


def _perhaps(read: Read) -> Read:
    return lambda value: None if value is None else read(value)


def _one_of(choices: type[StrEnum]) -> Read:
    def read(value: Any) -> StrEnum:
        if value not in list(choices):
            raise ValueError(f"one of {', '.join(choices)}")
        return choices(value)

    return read


_whole = _is(lambda value: type(value) is int, "a whole number")  # a bool is an int to isinstance
_number = _is(lambda value: type(value) in (int, float) and math.isfinite(value), "a number")
_text = _is(lambda value: isinstance(value, str), "a text")
_flag = _is(lambda value: isinstance(value, bool), "true or false")
_object = _is(lambda value: isinstance(value, dict), "an object")
_texts = _is(
    lambda value: isinstance(value, list) and all(isinstance(one, str) for one in value),
    "a list of texts",
)


def _finite(what: str) -> Read:
    """Read a number that a person gave for ``what``; Refused, in these words, for none."""

    def read(value: Any) -> float:
        right = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not right or not math.isfinite(value):
            raise Refused(f"{what} {value!r} isn't a finite number")
        return float(value)

    return read


def _steps(value: Any) -> dict[str, float]:
    return {str(axis).lower(): _finite(f"{axis} mm")(mm) for axis, mm in _object(value).items()}


def _axes(value: Any) -> list[str]:
    return [axis.lower() for axis in _texts(list(value) if isinstance(value, str) else value)]


@dataclass(frozen=True)
class Value:
    """How a value of a request is read, and what stands for one that isn't given."""

    read: Read
    default: Any = None


_SPEED: Final = Value(_perhaps(_finite("speed_mm_s")))
_PLACE: Final = {axis: Value(_perhaps(_finite(axis))) for axis in "xyz"}
_OF: Final = Value(_is(lambda value: value in ("print", "printer"), "print or printer"), "print")


@dataclass(frozen=True)
class Asked:
    """A request to a print: its values, and where an answer of its own goes."""

    values: Values
    reply: Reply

    def refuse(self, why: str) -> None:
        """Answer why it wasn't granted."""
        self.reply({"event": "refused", "message": why, "error": Refused.__name__})


def _reload(streamer: Streamer, asked: Asked) -> None:
    head = asked.values["head"]
    streamer.reload(*(() if head is None else (head,)))


def _resume(streamer: Streamer, asked: Asked) -> None:
    change, given = asked.values["change"], asked.values
    new = NewSyringe(**change) if change else None

    def answer(why: str) -> None:
        if why:
            asked.refuse(why)
        else:
            asked.reply({"event": "resumed"})

    streamer.resume(new, given["unchanged"], given["unobserved"], answer)


def _command(streamer: Streamer, asked: Asked) -> None:
    typed = asked.values["text"]

    def done(lines: tuple[bytes, ...]) -> None:
        said = [line.decode("ascii", "backslashreplace") for line in lines]
        asked.reply({"event": "reply", "do": "command", "command": typed.strip(), "lines": said})

    streamer.typed(typed, done, asked.refuse)


def _look(streamer: Streamer, asked: Asked) -> None:
    """Request an insert or a look's end; each has values of its own."""
    given = dict(asked.values)
    lines = tuple(given.pop("lines", ()))
    streamer.look(LookRequest(done=asked.reply, refused=asked.refuse, lines=lines, **given))


class Idle(Enum):
    """How a request is granted by a standing printer, in the thread that owns its port."""

    BESIDE = auto()
    """Also while another request waits."""
    ALONE = auto()
    """Refused while another one of these goes on."""
    MOVES = auto()
    """Alone, and something moves, or may: the station is busy."""


@dataclass(frozen=True)
class Word:
    """A request.

    Attributes
    ----------
    values : mapping of Value, or None
        None takes all that is given.
    on_print : callable or None
        Does it to a print that goes on, in the socket's thread; None where a print refuses it.
    answers : bool
        Whether a print gives an answer of its own, now or later.
    idle : Idle or None
        None where a standing printer refuses it.
    when_down : bool
        Whether it is granted while the printer can't be spoken to.
    """

    values: Mapping[str, Value] | None = field(default_factory=dict)
    on_print: Callable[[Streamer, Asked], None] | None = None
    answers: bool = False
    idle: Idle | None = None
    when_down: bool = False


WORDS: Final[dict[str, Word]] = {
    # --- in every mode; `Machine` does them
    "status": Word({"of": _OF}),
    "subscribe": Word({"of": _OF}),
    "detach": Word(),
    "kill": Word(),
    # --- to a print
    "stop": Word(on_print=lambda streamer, asked: streamer.stop()),
    "pause": Word(
        {"after": Value(_perhaps(_one_of(MarkKind)))},
        lambda streamer, asked: streamer.pause(asked.values["after"]),
    ),
    "reload": Word({"head": Value(_perhaps(_whole))}, _reload),
    "resume": Word(
        {
            "change": Value(_perhaps(_object)),
            "unchanged": Value(_flag, False),
            "unobserved": Value(_flag, False),
        },
        _resume,
        answers=True,
    ),
    "alive": Word(on_print=lambda streamer, asked: streamer.alive()),
    "insert": Word(
        {
            "look": Value(_whole),
            "lines": Value(_texts, []),
            "why": Value(_text, ""),
            "flow": Value(_perhaps(_number)),
            "again": Value(_flag, False),
        },
        _look,
        answers=True,
    ),
    "look_done": Word(
        {
            "look": Value(_whole),
            "decision": Value(_one_of(LookDecision)),
            "why": Value(_text, ""),
            "again": Value(_flag, False),
        },
        _look,
        answers=True,
    ),
    # --- to either
    "command": Word({"text": Value(_text)}, _command, answers=True, idle=Idle.MOVES),
    # --- to a standing printer; `IdleCommands` does them
    "jog": Word({"by": Value(_steps), "speed_mm_s": _SPEED}, idle=Idle.MOVES),
    "move_to": Word({**_PLACE, "speed_mm_s": _SPEED}, idle=Idle.MOVES),
    "home": Word({"axes": Value(_axes), "needle_off": Value(_flag, False)}, idle=Idle.MOVES),
    "plunger": Word(
        {"ul": Value(_finite("ul")), "ul_s": Value(_perhaps(_finite("ul_s")))}, idle=Idle.MOVES
    ),
    "heat": Word({"name": Value(_text), "celsius": Value(_finite("celsius"))}, idle=Idle.BESIDE),
    "touch_off": Word(
        {"z": Value(_perhaps(_finite("z"))), "foil_mm": Value(_finite("foil_mm"), 0.0)},
        idle=Idle.BESIDE,
    ),
    "set_position": Word(_PLACE, idle=Idle.BESIDE),
    # --- to a station; `station` does them
    "stop_motion": Word(),
    "mount": Word(None, idle=Idle.BESIDE, when_down=True),
    "print": Word({"order": Value(_object)}, idle=Idle.ALONE),
    "reconnect": Word(idle=Idle.ALONE, when_down=True),
    "close": Word(idle=Idle.ALONE, when_down=True),
}
"""Every request by its name (``do``); others are refused."""


def read_values(request: Mapping[str, Any]) -> Values:
    """Return a request's values, read as its word says; others in it are left out.

    Refused for one that is missing or of another type.
    """
    values = WORDS[request["do"]].values
    if values is None:
        own = ("do", "token", "answer", "print", "by")
        return {name: value for name, value in request.items() if name not in own}
    read = {}
    for name, value in values.items():
        try:
            read[name] = value.read(request.get(name, value.default))
        except ValueError as exc:
            shown = repr(request[name])[:80] if name in request else "missing"
            raise Refused(f"{request['do']}: {name} is {shown}, and must be {exc}") from exc
    return read


def action_of(request: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """Return the journal's record of a request: what, by whom, from where, with which values."""
    given = {k: v for k, v in values.items() if v not in (None, False, "", []) and k != "lines"}
    told = {"given": given} if given else {}
    return {"do": request["do"], **told, **read_actor(request.get("by"))}
