"""Files of each inspection of a print: picture, findings, decision, answer; its text.

``looks/0007/`` beside the journal holds ``picture.*``, ``again.*`` (a second picture), ``seen.png``
(the picture with what was expected and found), ``look.json`` (written last, at once: a look with it
is judged), ``insert.gcode`` where lines were put into the job, and ``answer.json``, the operator's
word.
"""

from __future__ import annotations

import json
import math
import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from design.files import write_text
from printctl.machine.process.contact import alive
from printctl.machine.records.actor import actor, read_actor
from printctl.machine.records.states import LinkState, Status

Answer = Literal["approve", "go_on", "stop"]
ANSWERS: Final[tuple[Answer, ...]] = ("approve", "go_on", "stop")
LOOKS_FOLDER: Final = "looks"
_ANSWER_FILE: Final = "answer.json"
OBSERVER_LOCK: Final = "observer.lock"
"""Held in the print's folder while an observer is at work."""
ORDER_FILE: Final = "observer.json"
"""An observer's order, beside a run's G-code and in a print's folder (`ObserverOrder`)."""
LOG_FILE: Final = "observer.log"
READY_FILE: Final = "observer.pid"
"""Process id of an observer that is ready."""
POSTPONED_KEY: Final = "postponed"
"""Key in `LookRecord.found`: too little was seen within a vessel, the next look judges it."""
STATE_KEY: Final = "learned"
"""Key in `LookRecord.control`: the saved `InspectionState`."""
DRAWING_FILE: Final = "seen.png"
OUTCOMES: Final = {
    "go_on": "gone on",
    "flow": "flow corrected",
    "mend": "mended",
    "pause": "paused",
    "stop": "cancelled",
}
"""Words for what was done after a look, by its decision."""
PROPOSALS: Final = {
    "mend": "write again what is missing",
    "flow": "correct the flow of all that follows",
    "pause": "wait",
}
"""Words for what the operator is to approve, by the proposed decision."""

_MIN_SEEN_SHARE: Final = 0.5
"""Share of the way below which a look counts as unseen in the summary."""
_PICTURE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


@dataclass(frozen=True)
class LookRecord:
    """Record of one look (``look.json``).

    Attributes
    ----------
    number : int
        Of the look, from 1.
    done : int
        Command lines of the growing job that were taken.
    job_line : int
        The same, of the job's file: without inserts.
    mark : str
        What had ended there.
    at : float, s since 1970
    decision, why : str
    asked : str
        Decision that the operator is to approve; empty for none.
    factor : float or None
        Flow factor put in force.
    found : dict
        Figures: gaps, width ratio, share seen, shift.
    control : dict
        State of the flow control and the decider after this look, to go on from.
    seconds : dict
        How long acquiring, judging and deciding took.
    """

    number: int
    done: int
    job_line: int
    mark: str
    at: float
    decision: str
    why: str
    asked: str = ""
    factor: float | None = None
    found: dict[str, Any] = field(default_factory=dict)
    control: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def has_judgement(self) -> bool:
        """Whether a picture was judged; False for a failed or postponed look."""
        return "seen_share" in self.found and not self.found.get(POSTPONED_KEY)


def look_folder(print_folder: Path, number: int) -> Path:
    """Return the folder of a look; make it if it is missing."""
    path = print_folder / LOOKS_FOLDER / f"{number:04d}"
    path.mkdir(0o700, parents=True, exist_ok=True)
    return path


def clear_look_folder(print_folder: Path, number: int) -> Path:
    """Return the folder of a new look, emptied of an earlier print's files."""
    path = look_folder(print_folder, number)
    for old in path.iterdir():
        if old.is_dir():  # pictures of a laser's sweep
            shutil.rmtree(old)
        else:
            old.unlink()
    return path


def save_look(print_folder: Path, record: LookRecord) -> None:
    """Write a new look's record and delete the answer to an earlier print's look of its number.

    Raises
    ------
    OSError
        When the disk is full.
    """
    (look_folder(print_folder, record.number) / _ANSWER_FILE).unlink(missing_ok=True)
    amend_look(print_folder, record)


def amend_look(print_folder: Path, record: LookRecord) -> None:
    """Write a look's record again and keep its answer.

    Raises
    ------
    OSError
        When the disk is full.
    """
    path = look_folder(print_folder, record.number) / "look.json"
    write_text(path, json.dumps(asdict(record), indent=1, allow_nan=False) + "\n")


def read_looks(print_folder: Path, since: float = 0.0) -> list[LookRecord]:
    """Return the looks that were judged, in their order; what can't be read is left out.

    Parameters
    ----------
    print_folder : Path
    since : float, s since 1970
        Begin of the print: earlier looks are of an earlier print in the folder.
    """
    looks = []
    for path in sorted((print_folder / LOOKS_FOLDER).glob("*/look.json")):
        try:
            look = LookRecord(**json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            continue
        if look.at >= since:
            looks.append(look)
    return looks


def look_picture(print_folder: Path, number: int) -> Path | None:
    """Return a look's picture with what was found drawn in, else as it was taken; None for none."""
    place = print_folder / LOOKS_FOLDER / f"{number:04d}"
    drawn = place / DRAWING_FILE
    if drawn.is_file():
        return drawn
    taken = (
        path for path in sorted(place.glob("picture.*")) if path.suffix.lower() in _PICTURE_SUFFIXES
    )
    return next(taken, None)


def answer_look(print_folder: Path, number: int, answer: str) -> None:
    """Write the operator's answer to a look for the waiting observer.

    Raises
    ------
    ValueError
        When there is no such answer, that look asks for none, or it was answered otherwise.
    """
    if answer not in ANSWERS:
        raise ValueError(f"{answer!r} is no answer; say {', '.join(ANSWERS)}")
    open_looks = [one for one in read_looks(print_folder) if one.number == number and one.asked]
    if not open_looks:
        raise ValueError(f"look {number} asks for nothing; `printctl observe looks` lists them")
    path = look_folder(print_folder, number) / _ANSWER_FILE
    text = json.dumps({"answer": answer, **actor()}) + "\n"
    try:
        with path.open("x", encoding="utf-8") as file:  # of two at once one is refused
            file.write(text)
    except FileExistsError:
        given = read_answer(print_folder, number)
        if given is None:  # cut by a full disk
            write_text(path, text)
        elif given != answer:
            raise ValueError(
                f"look {number} was answered before: {given}; `printctl cancel` and `resume` work "
                "as ever"
            ) from None


def is_paused_by_look(status: Status, number: int) -> bool:
    """Return whether a print is paused by a look."""
    look = status.look
    return status.state is LinkState.PAUSED and look is not None and look["number"] == number


def look_awaiting_answer(looks: Iterable[LookRecord], status: Status) -> LookRecord | None:
    """Return the look for whose answer a paused print waits; None for none."""
    return next((one for one in looks if one.asked and is_paused_by_look(status, one.number)), None)


def refuse_without_observer(print_folder: Path) -> None:
    """Refuse an answer if no observer is running to act on it.

    Raises
    ------
    ValueError
    """
    if not alive(print_folder, OBSERVER_LOCK):
        raise ValueError(
            f"no observer is at work in {print_folder}, so nobody would act on the answer (its "
            "observer.log may say why): `printctl resume` starts another one, which asks again"
        )


def read_answer(print_folder: Path, number: int) -> Answer | None:
    """Return the operator's answer to a look; None while there is none."""
    answer = _answer_file(print_folder, number).get("answer")
    return answer if answer in ANSWERS else None


def who_answered(print_folder: Path, number: int) -> dict[str, str]:
    """Return ``who`` has answered a look and ``from`` where; empty where that isn't known."""
    return read_actor(_answer_file(print_folder, number))


def _answer_file(print_folder: Path, number: int) -> dict[str, Any]:
    path = print_folder / LOOKS_FOLDER / f"{number:04d}" / _ANSWER_FILE
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return given if isinstance(given, dict) else {}


def seen_words(look: LookRecord) -> str:
    """Return in words the share of the way seen and its share with ink; empty for nothing seen."""
    seen, ink = look.found.get("seen_share"), look.found.get("coverage")
    if seen is None:
        return ""
    return f"{seen:.0%} seen" + ("" if ink is None else f", {ink:.0%} of it with ink")


def proposal_words(look: LookRecord) -> str:
    """Return in words what a look proposes to the operator; empty for nothing."""
    if not look.asked:
        return ""
    words = PROPOSALS[look.asked]
    if look.factor is None:
        return words
    return f"{words}, flow factor {look.factor:.2f}"


def outcome_words(look: LookRecord, answer: Answer | None) -> str:
    """Return in words the outcome of a look: its decision, or the operator's answer."""
    if not look.asked:
        return OUTCOMES.get(look.decision, look.decision)
    if answer is None:
        return f"asks to {PROPOSALS[look.asked]}"
    if answer == "approve":
        return f"{OUTCOMES.get(look.asked, look.asked)}, approved"
    return "gone on without" if answer == "go_on" else "cancelled by the operator"


def total_words(looks: Sequence[LookRecord]) -> str:
    """Summarise a print's looks: outcomes, gaps left, and looks that saw too little."""
    count = Counter(OUTCOMES.get(one.decision, one.decision) for one in looks)
    outcomes = ", ".join(f"{number} {what}" for what, number in count.items())
    words = f"{len(looks)} look{'s' * (len(looks) != 1)}: {outcomes}"
    if left_mm := math.fsum(one.found.get("left_mm", 0.0) for one in looks):
        words += f"; {left_mm:.2f} mm of gaps left as they are"
    seen = [one.found.get("seen_share") or 0.0 for one in looks]
    if dark := sum(share < _MIN_SEEN_SHARE for share in seen):
        words += f"; of {dark} less than {_MIN_SEEN_SHARE:.0%} was seen"
    return words
