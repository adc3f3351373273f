"""`printctl observe looks`, `answer`: list a print's camera inspections; answer the last one."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, print_json, print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.errors import UsageError
from printctl.machine.link.find_link import alive
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.states import Status
from printctl.machine.print_state.state import read_print
from printctl.machine.printing.journal_facts import read_journal_facts
from printctl.observe.look_words import proposal_words, seen_words, total_words
from printctl.observe.records import (
    OBSERVER_LOCK,
    ORDER,
    Answer,
    LookRecord,
    answer_look,
    answer_of,
    asking_look,
    held_for,
    look_folder,
    read_looks,
    refuse_unheard,
)
from printctl.run_folder.artefacts import JOURNAL_FOLDER
from printctl.settings import arg, opt

FrameFile = Annotated[
    Path, typer.Option("--frame", help="File of `printctl observe frame`.", show_default=False)
]


def looks(run: RunArg, as_json: JsonFlag = False) -> None:
    """List the looks at a print: what was found, decided and asked.

    Pictures, with what was expected and found drawn in, are in the print's folder, under looks.
    """
    folder = print_folder(run)
    found = read_looks(folder, read_journal_facts(folder / JOURNAL).started)
    if as_json:
        print_json([asdict(one) for one in found])
        return
    if not found:
        none_yet = unlooked_lines(folder) or ["observe is a recipe's part"]
        raise UsageError(f"nobody has looked at the print in {folder}; {none_yet[0]}")
    print_lines(*(_words(one, answer_of(folder, one.number)) for one in found))
    print_lines(*asking_lines(folder, read_print(folder).status))


def asking_lines(folder: Path, status: Status) -> list[str]:
    """What the look that the print waits at proposes, and how to answer it; none for no such."""
    looks = read_looks(folder, read_journal_facts(folder / JOURNAL).started)
    last = asking_look(looks, status)
    if last is None or answer_of(folder, last.number) is not None:
        return []
    if not alive(folder, OBSERVER_LOCK):
        return [
            f"look {last.number} asks to {proposal_words(last)}, but its observer is gone: "
            "`printctl resume RUN` starts another one, which asks again"
        ]
    return [
        f"look {last.number} asks to {proposal_words(last)}: see "
        f"{look_folder(folder, last.number)}, then `printctl observe answer RUN approve --look "
        f"{last.number}` (or go_on, stop)"
    ]


def looks_lines(run: Path) -> list[str]:
    """What came of the looks at a run's print, in a line; none for a print that isn't observed."""
    folder = run / JOURNAL_FOLDER
    if not (folder / JOURNAL).is_file():
        return []
    found = read_looks(folder, read_journal_facts(folder / JOURNAL).started)
    if found:
        return [f"{total_words(found)}; `printctl observe looks {run}`"]
    return [f"nobody looked at the print: {words}" for words in unlooked_lines(run)]


def unlooked_lines(folder: Path) -> list[str]:
    """Why an observed print of a folder has no look; none of a print that isn't observed."""
    if not (folder / ORDER).is_file():
        return []
    return [
        "observe.every asked for no look before its end (a simulated printer is quicker than the "
        "clock, a part may be lower than a height gained: say `60 s written` or `layer`)"
    ]


@command
def answer(
    run: RunArg,
    word: str = arg("approve: do what is proposed. go_on: without it. stop: end the print."),
    look: int | None = opt(
        "The look that is meant: refused if another one asks by now.",
        min=1,
        show_default="the last one",
    ),
) -> None:
    """Answer the last look of a print that waits for the operator's word.

    A look asks where something is to be written (observe.mend: ask), or where no ink came: clear
    the needle first. `printctl observe looks` says what is proposed.
    """
    folder = print_folder(run)
    found = read_looks(folder, read_journal_facts(folder / JOURNAL).started)
    try:
        if not found:
            raise ValueError(f"nobody has looked at the print in {folder}")
        if look not in (None, found[-1].number):
            raise ValueError(
                f"look {look} isn't the last, which is look {found[-1].number}; nothing was done"
            )
        _refuse_unheld(read_print(folder).status, found[-1])
        refuse_unheard(folder)
        answer_look(folder, found[-1].number, word)
    except ValueError as exc:
        raise UsageError(str(exc)) from exc
    print_lines(f"look {found[-1].number}: {word}; `printctl status` tells what the print does")


def _refuse_unheld(status: Status, look: LookRecord) -> None:
    """Refuse an answer that the print doesn't wait for.

    Raises
    ------
    ValueError
    """
    if not held_for(status, look.number):
        raise ValueError(
            f"the print doesn't wait for a word on look {look.number} (it is "
            f"{status.state.value}); nothing was done"
        )


def _words(look: LookRecord, word: Answer | None) -> str:
    seen = seen_words(look)
    share = f", {seen}" if seen else ""
    answered = f"; answered: {word}" if look.asked and word else ""
    return f"look {look.number} ({look.mark}){share}: {look.decision}: {look.why}{answered}"
