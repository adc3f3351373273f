"""State of a printer's commissioning, in one JSON file, and the answers that a step asks for."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal

from design.files import write_text
from firmware_profiles import Facts, ProfileError, shipped
from printctl.errors import PrintctlError, SafetyError, UsageError
from printctl.machine.errors import Refused
from printctl.machine.records.folders import data_folder
from printctl.machine.records.mounting import as_kept, file_name

StepState = Literal["open", "failed", "done"]
YES_NO: Final = ("yes", "no")
EXPECTED: Final = "expected"
"""In place of a file of widths: those that a simulated ink should have."""


@dataclass
class StepRecord:
    """What a step has come to.

    Attributes
    ----------
    state : str
    message : str
        Result of its check, with the remedy where it failed.
    when : str
        Of the last change, ISO.
    answers : dict of str to str
        What was answered so far.
    facts : dict
        Results of actions that aren't repeated, by the action's name; and what the check recorded.
    """

    state: StepState = "open"
    message: str = ""
    when: str = ""
    answers: dict[str, str] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass
class Commission:
    """Commissioning of one printer: its profile's file, and a record for each step."""

    printer: str
    steps: dict[str, StepRecord] = field(default_factory=dict)

    @staticmethod
    def load(printer: str) -> Commission:
        """Return what is kept of a printer; an empty one where nothing is.

        Raises
        ------
        PrintctlError
            When its file can't be read.
        """
        made = Commission(as_kept(printer))
        try:
            data = json.loads(made.file.read_text(encoding="utf-8"))
            made.steps = {key: StepRecord(**one) for key, one in data["steps"].items()}
        except FileNotFoundError:
            pass
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as exc:
            raise PrintctlError(
                f"{made.file}, the state of this commissioning, can't be read ({exc}); move it "
                "away to begin again"
            ) from exc
        return made

    @property
    def file(self) -> Path:
        """Where it is kept: beside the folder of what is mounted."""
        return data_folder() / "commissioned" / file_name(self.printer)

    @property
    def folder(self) -> Path:
        """Folder of its G-code, sheets, first part and scan, beside the profile."""
        return Path(self.printer).with_suffix("").with_name(f"{Path(self.printer).stem}_commission")

    def step(self, key: str) -> StepRecord:
        """Return the record of a step."""
        return self.steps.setdefault(key, StepRecord())

    def save(self) -> None:
        """Write the file."""
        data = {"printer": self.printer, "steps": {k: asdict(v) for k, v in self.steps.items()}}
        write_text(self.file, json.dumps(data, indent=1) + "\n")


@dataclass(frozen=True)
class Question:
    """Something asked of a person.

    Attributes
    ----------
    key : str
    text : str
    default : str
        Taken for an empty answer; empty where a person must answer.
    choices : tuple of str
        Allowed answers; empty for any.
    acts : bool
        Whether yes moves, heats, pushes or writes something: such an answer isn't kept.
    """

    key: str
    text: str
    default: str = ""
    choices: tuple[str, ...] = ()
    acts: bool = False


class UnansweredError(UsageError):
    """A step waits for an answer."""

    def __init__(self, step: str, question: Question) -> None:
        self.step, self.question = step, question
        allowed = f" ({', '.join(question.choices)})" if question.choices else ""
        how = "--yes" if question.acts else f"--answer {question.key}=VALUE{allowed}"
        super().__init__(
            f"step {step!r} waits for an answer: {question.text} Run it on a terminal, or add {how}"
        )


class CheckFailedError(PrintctlError):
    """A step's check failed; the step stays open.

    ``forget`` names the answers and actions that are asked for and done again.
    """

    def __init__(self, message: str, *forget: str) -> None:
        super().__init__(message)
        self.forget = forget


@contextmanager
def asked_again(*keys: str) -> Iterator[None]:
    """Turn a user's mistake into a failed check that asks for these answers again.

    Raises
    ------
    CheckFailedError
    """
    try:
        yield
    except (UsageError, ProfileError, Refused) as exc:
        raise CheckFailedError(str(exc), *keys) from exc


Answering = Callable[[Question], str | None]
"""Gives a person's answer to a question; None where there is none yet."""


@dataclass
class Desk:
    """What one step asks, does once and says."""

    commission: Commission
    key: str
    answering: Answering
    say: Callable[[str], None]

    @property
    def record(self) -> StepRecord:
        """The step's."""
        return self.commission.step(self.key)

    def ask(
        self,
        key: str,
        text: str,
        default: str = "",
        choices: Iterable[str] = (),
        check: Callable[[str], object] | None = None,
    ) -> str:
        """Return the answer, as it was given before or is given now.

        Raises
        ------
        UnansweredError
        UsageError
            For an answer that isn't among the choices.
        CheckFailedError
            For one that ``check`` refuses; it is asked for again.
        """
        if key not in self.record.answers:
            question = Question(key, text, default, tuple(choices))
            self.record.answers[key] = self._answer(question)
            self.commission.save()
        if check is not None:
            with asked_again(key):
                check(self.record.answers[key])
        return self.record.answers[key]

    def numbers(self, key: str, text: str, count: int, default: str = "") -> list[float]:
        """Return so many numbers with commas between them.

        Raises
        ------
        CheckFailedError
            For anything else.
        """
        answer = self.ask(key, text, default)
        try:
            values = [float(word) for word in answer.replace(";", ",").split(",")]
        except ValueError:
            values = []
        if len(values) != count or not all(abs(one) < 1e6 for one in values):
            what = "a number" if count == 1 else f"{count} numbers with commas between them"
            raise CheckFailedError(f"{key}={answer!r} isn't {what}; answer again", key)
        return values

    def confirm(self, key: str, text: str) -> None:
        """Have a person say yes to what moves, pushes or writes something.

        Raises
        ------
        UnansweredError
        SafetyError
            For any other answer; nothing was done.
        """
        if self._answer(Question(key, text, "", YES_NO, acts=True)) != "yes":
            raise SafetyError(f"step {self.key!r}: not confirmed, and nothing was done: {text}")

    def once(self, key: str, action: Callable[[], Any], confirm: str = "") -> Any:
        """Return what an action gave, which is done only where it wasn't yet.

        With ``confirm``, a person is asked before. What it gives is kept as JSON.
        """
        if key not in self.record.facts:
            if confirm:
                self.confirm(key, confirm)
            self.record.facts[key] = action()
            self.commission.save()
        return self.record.facts[key]

    def _answer(self, question: Question) -> str:
        answer = self.answering(question)
        if answer is None:
            raise UnansweredError(self.key, question)
        answer = answer.strip() or question.default
        if not answer or (question.choices and answer not in question.choices):
            raise UsageError(
                f"{question.key}={answer!r} is no answer to: {question.text} Give "
                + (f"one of {', '.join(question.choices)}" if question.choices else "a value")
            )
        return answer


def profile_choices(model: type[Facts]) -> str:
    """Return what a question about a profile takes: the shipped names, or a file."""
    return f"{', '.join(shipped(model))}, or a .yaml file of your own"


def now() -> str:
    """Return the time for a record."""
    return datetime.now().isoformat(timespec="seconds")
