"""`printctl commission`: set up a printer by guided steps, each ended by a check."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from firmware_profiles import Printer, shipped
from printctl.cli.declare import json_command, wants_json
from printctl.cli.options import print_note, print_result
from printctl.commissioning.state import CheckFailedError, Commission, Question
from printctl.commissioning.steps import (
    change_port,
    do_next,
    next_step,
    overview,
    reopen,
    step_named,
)
from printctl.errors import UsageError
from printctl.machine.process.contact import usual_folder
from printctl.settings import opt

MARKS = {"done": "done  ", "failed": "FAILED", "open": "open  "}


@json_command
def commission(
    printer: str = opt(
        "The printer's own profile, a .yaml file, created if missing; for a shipped NAME "
        "my_NAME.yaml.",
        "my_printer.yaml",
    ),
    port: str | None = opt("Serial port, tcp:HOST:PORT, auto or simulated."),
    status: bool = opt("Show the steps and their results; do nothing.", False),
    begin: str | None = opt("Restart at this step.", None, "--from", metavar="STEP"),
    until: str | None = opt("Stop after this step.", metavar="STEP"),
    answer: list[str] | None = opt("Answer to a question; may be repeated.", metavar="KEY=VALUE"),
    accept_change: bool = opt("Accept a constant that changes by more than 20 %.", False),
    yes: bool = opt(
        "Confirm all moves, dispensing and writing, and use default answers without prompting.",
        False,
    ),
    sim_speed: float = opt(
        "Speed of a simulated printer relative to real time; 0: maximum.", 0.0, min=0
    ),
    folder: Path | None = opt("Folder of the station.", show_default="the user's data"),
) -> None:
    """Set up a printer: profile, connection, steps, parts, touch-off, first prints, correction.

    It goes on where it stopped. Each step ends with a check; where that fails, the step stays open
    and the message says what to do. What moves, pushes or writes asks first.
    """
    named = f"my_{printer}.yaml" if printer in shipped(Printer) else printer
    if not named.endswith((".yaml", ".yml")):
        raise UsageError(
            f"--printer {printer} is neither a .yaml file nor a shipped profile; name the file "
            "that is to hold this printer's profile, such as my_printer.yaml"
        )
    kept = Commission.load(named)
    if begin is not None:
        reopen(kept, begin)
    if until is not None:
        step_named(until)
    if not status:
        given = _given(answer or [])
        given |= {"port": port} if port is not None else {}
        given |= {} if named == printer or Path(named).exists() else {"profile": printer}
        given |= {"accept_change": "yes"} if accept_change else {}
        if port is not None:
            change_port(kept, port)
        typed: set[str] = set()
        answering = _answering(given, yes, typed)
        while (step := next_step(kept)) is not None:
            number = [one["key"] for one in overview(kept)["steps"]].index(step.key) + 1
            print_note(f"\n{number}. {step.title}: {step.how}. Needs {step.needs}.")
            try:
                do_next(kept, answering, print_note, folder or usual_folder(), sim_speed)
            except CheckFailedError as failed:
                if not failed.forget or not typed.issuperset(failed.forget):
                    raise
                print_note(f"   {failed}")
                typed.clear()
                continue
            print_note(f"   done: {kept.step(step.key).message}")
            if step.key == until:
                break
    facts = overview(kept)
    print_result(facts, _lines(facts))


def _given(answers: list[str]) -> dict[str, str]:
    pairs = [one.partition("=") for one in answers]
    wrong = [key for key, sign, _ in pairs if not (key and sign)]
    if wrong:
        raise UsageError(f"--answer {wrong[0]!r} isn't KEY=VALUE; write it like needle=25g")
    return {key: value for key, _, value in pairs}


def _answering(
    given: dict[str, str], yes: bool, typed: set[str]
) -> Callable[[Question], str | None]:
    """Answer by what is given, then as --yes says, then by asking on the terminal.

    Keys of what was asked there go into ``typed``: such an answer can be asked for again at once.
    """

    def answer(question: Question) -> str | None:
        if question.key in given:
            return given.pop(question.key)  # asked again, it was wrong
        if yes:
            return "yes" if question.acts else question.default or None
        if wants_json() or not sys.stdin.isatty():
            return None
        typed.add(question.key)
        return _ask(question)

    return answer


def _ask(question: Question) -> str | None:
    """Ask on stderr until the answer is one that can be; None at the end of input."""
    choices = f" ({'/'.join(question.choices)})" if question.choices else ""
    usual = f" [{question.default}]" if question.default else ""
    while True:
        sys.stderr.write(f"   {question.text}{choices}{usual} ")
        sys.stderr.flush()
        line = sys.stdin.readline()
        if not line:
            return None
        text = line.strip() or question.default
        if text and (not question.choices or text in question.choices):
            return text
        allowed = ", ".join(question.choices)
        print_note(f"   please answer one of {allowed}" if allowed else "   please type an answer")


def _lines(facts: dict[str, Any]) -> list[str]:
    lines = [f"{facts['printer']} at {facts['port'] or 'no port yet'}"]
    for number, one in enumerate(facts["steps"], start=1):
        lines.append(
            f"{number} {MARKS[one['state']]} {one['key']:<11} {one['message'] or one['check']}"
        )
    following = "the printer is commissioned" if facts["done"] else f"next: {facts['next']}"
    return [*lines, following]
