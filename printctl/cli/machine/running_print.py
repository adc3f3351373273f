"""Commands to a print that runs or has ended: status, cancel, pause, resume and so on."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Final, Literal

from printctl.cli.declare import command, json_command, wants_json
from printctl.cli.options import (
    GoingOnArg,
    RunArg,
    messages,
    print_lines,
    print_result,
    refuse_input_as_output,
)
from printctl.errors import SafetyError, UsageError
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.control.excursion import CHANGE
from printctl.machine.errors import LinkError
from printctl.machine.job.marks import MarkKind
from printctl.machine.prints.give_up import give_up as give_up_print
from printctl.machine.prints.recovery_file import planned, write_rest
from printctl.machine.prints.state import (
    Possible,
    PrintAction,
    PrintTruth,
    print_folder,
    read_print,
    run_going_on,
    running_print,
)
from printctl.machine.prints.words import alarm_words
from printctl.machine.process.clients.client import attach
from printctl.machine.process.contact import alive
from printctl.machine.process.outcome import may_still_move
from printctl.machine.records.actor import this_user
from printctl.machine.records.record import JOURNAL, load_record
from printctl.machine.records.replay import read_journal_if_any
from printctl.machine.records.states import LinkState, Status, state_words
from printctl.observe import records
from printctl.observe.continue_print import continue_print
from printctl.observe.records import proposal_words, seen_words, total_words
from printctl.run_folder.artefacts import JOURNAL_FOLDER
from printctl.settings import arg, opt


def _looks(folder: Path) -> list[records.LookRecord]:
    """What was seen of the print whose journal is in a folder."""
    return records.read_looks(folder, read_journal_if_any(folder / JOURNAL).started)


_COMMANDS = {
    PrintAction.GO_ON: "continue: printctl resume",
    PrintAction.RECOVER: "recover: printctl recover",
    PrintAction.GIVE_UP: "give up: printctl give-up",
}


@json_command
def status(run: GoingOnArg = None) -> None:
    """Show the status of a print (running, paused or ended) and the possible actions.

    Read only: the print isn't affected. For an ended print the journal is read.
    """
    run = run_going_on(run)
    folder = print_folder(run)
    state = read_print(folder)
    print_result(
        state.to_dict(),
        lambda: [*status_lines(state, str(run)), *asking_lines(folder, state.status)],
    )


def status_lines(truth: PrintTruth, run: str) -> list[str]:
    """A print for people."""
    status = truth.status
    lines = [
        f"{state_words(status.state)}: {status.message}",
        f"{truth.words['made']}; {status.lines_done} of {status.lines_total} lines accepted, line "
        f"{status.file_line} of the file",
        *(truth.words[key] for key in ("time", "layer", "vessel", "ink") if truth.words[key]),
        *waiting_lines(status),
    ]
    if status.line_errors:
        lines.append(f"{status.line_errors} lines resent")
    if status.alarms:
        lines.append(alarm_words(status.alarms, truth.journal.last_alarm))
    if not status.position_known:
        lines.append("position unknown")
    return [*lines, *(_offered(truth.actions, run) if status.ended else ())]


def waiting_lines(status: Status) -> list[str]:
    """Say what a print waits for and what the machine reads."""
    lines = [f"waits for: {status.waits_for}"] if status.waits_for else []
    if status.deadman_left_s is not None and not status.ended:
        lines.append(
            f"dead-man: pauses or cancels in {status.deadman_left_s / 60:.1f} min unless confirmed "
            "by `printctl alive`"
        )
    return lines + [f"reads {reading}" for reading in status.readings]


def _offered(actions: Iterable[Possible], run: str) -> Iterator[str]:
    """The commands of what is possible now."""
    for one in actions:
        if not one.possible or one.action not in _COMMANDS:
            continue
        command = f"{_COMMANDS[one.action]} {shlex.quote(run)}"
        if one.needs != "from_line":
            yield command
        elif one.from_line:
            yield f"{command} --from-line {one.from_line} ({one.reason})"
        else:
            yield f"recover: {one.reason} (printctl recover --help)"


STOP_S: Final = 20.0
"""Longest wait for the end of a cancelled print; the line in flight may take longer."""
HALT_S: Final = 10.0
"""Longest wait for the printer's word that it has halted."""


def cancel(run: GoingOnArg = None) -> None:
    """Cancel a print: relieve the plunger, lift the needle straight up, switch the heaters off.

    The position stays known, and `printctl recover RUN` continues with the rest. To halt the
    printer at once use `printctl emergency-stop`.
    """
    run = run_going_on(run)
    with running_print(run) as client:
        client.stop()
        try:
            outcome = client.wait(STOP_S)
        except TimeoutError:
            now = client.status
            print_lines(
                f"cancelling is requested but not finished after {STOP_S:.0f} s; now "
                f"{state_words(now.state)}: {now.message}; `printctl status {run}` reports the end"
            )
            return
    print_lines(f"{state_words(outcome.state)}: {outcome.message}")


def stop(run: GoingOnArg = None) -> None:
    """Cancel a print; the earlier name of `printctl cancel`."""
    messages().print(
        "`printctl stop` cancels the print in an orderly way; to halt the printer at once use "
        "`printctl emergency-stop`",
        markup=False,
    )
    cancel(run)


def emergency_stop(run: GoingOnArg = None) -> None:
    """Halt the printer of a print at once, past all queues; its position is lost.

    A Marlin with emergency parser gets M410 first and M112 after 2.8 s, or 3.8 s where the profile
    has two lines in flight; others M112 at once.
    Where the print's own process is gone, the print's port is opened and the halt written to it; a
    network host that runs another file isn't halted, nor one that doesn't run an ended print's.
    Check the needle afterwards and reset the printer; `printctl recover RUN` plans the rest. To
    end a print in an orderly way use `printctl cancel`.
    """
    run = run_going_on(run)
    with attach(print_folder(run)) as client:
        client.kill()
        try:
            outcome = client.wait(HALT_S)
        except TimeoutError:
            raise LinkError(
                f"the link process of {client.folder} hasn't said within {HALT_S:.0f} s that the "
                "printer has halted: cut the printer's power"
            ) from None
        if UNCONFIRMED in outcome.message:
            raise LinkError(outcome.message)
        if may_still_move(outcome):  # the process ended as it was asked
            client.kill()
            outcome = client.wait(HALT_S)
    before = "" if outcome.state is LinkState.KILLED else "not halted, for the print had ended: "
    print_lines(f"{before}{state_words(outcome.state)}: {outcome.message}")


@command
def pause(
    run: GoingOnArg = None,
    after: Literal["layer", "vessel"] | None = opt("Finish the current layer or vessel first."),
    now: bool = opt("Pause after the current line; the default.", False),
) -> None:
    """Hold a print: relieve the plunger, lift the needle straight up, keep the temperatures.

    `printctl resume RUN` returns to the same point and continues.
    """
    run = run_going_on(run)
    if now and after:
        raise UsageError("--now and --after exclude each other; give one")
    with running_print(run) as client:
        state = client.status.state
        if state is LinkState.PAUSED:
            print_lines(f"already paused; `printctl resume {run}` continues")
            return
        if state is LinkState.PAUSING:
            print_lines(f"already pausing; `printctl status {run}` reports when it is paused")
            return
        client.pause(MarkKind(after) if after else None)
        held = "after the current line and the printer's queued moves"
        where = f"at the end of this {after}" if after else held
        print_lines(f"will pause {where}; `printctl status {run}` reports when")


@command
def resume(
    run: GoingOnArg = None,
    syringe: str | None = opt("Profile of the new syringe."),
    plunger_mm: float | None = opt(
        "Plunger travel already used, mm; 0 for a full syringe.", min=0.0
    ),
    unchanged: bool = opt("The syringe wasn't changed after all.", False),
    port: str | None = opt("New name of the printer's port."),
    unobserved: bool = opt(
        "Start no observer for a print with looks: each look pauses it after its limit.", False
    ),
) -> None:
    """Resume a print: return to its position, prime, verify the position, print.

    If the link process died or lost its port, the printer's last line is queried first. An observed
    print whose observer has exited gets a new one first.
    """
    run = run_going_on(run)
    if unchanged and (syringe is not None or plunger_mm is not None):
        raise UsageError("--unchanged excludes --syringe and --plunger-mm")
    folder = print_folder(run)
    with attach(folder) as attached:
        ended = attached.status.ended
    unheard = not (unobserved or alive(folder, records.OBSERVER_LOCK))
    status = continue_print(
        folder,
        port=port,
        syringe=syringe,
        plunger_mm=plunger_mm,
        unchanged=unchanged,
        unobserved=unobserved,
    )
    if status.ended and status.state is not LinkState.DONE:
        raise LinkError(f"not continued: {status.message}")
    if unheard and (asking := asking_lines(folder, status)):
        print_lines("another observer is active, and the print stays paused for an answer", *asking)
        return
    where = (
        "from the printer's last line" if ended else (f"`printctl status {run}` shows the progress")
    )
    print_lines(f"resuming; {where}")


@command
def reload(
    run: GoingOnArg = None,
    head: int | None = opt("Head to reload; default: the active one.", min=0),
) -> None:
    """Pause a print at its next reload point, with the needle raised to change the syringe.

    A print that is already paused stays where it is, and the needle is raised further.
    """
    run = run_going_on(run)
    with running_print(run) as client:
        here = client.status.state in (LinkState.PAUSED, LinkState.LOOKING)
        client.reload(head)
        where = "here" if here else "at the next reload point"
        print_lines(f"will raise the needle {where}; then {CHANGE.replace('RUN', str(run))}")


def confirm_presence(run: GoingOnArg = None) -> None:
    """Reset the dead-man timer of a print (`printctl print --deadman`).

    Confirms that an operator is present; otherwise the print pauses, or is cancelled, when the
    time is up.
    """
    run = run_going_on(run)
    with running_print(run) as client:
        client.alive()
        left = client.status.deadman_left_s
    again = "this print has no dead-man timer"
    print_lines(
        f"confirmed; {again if left is None else f'confirm again within {left / 60:.1f} min'}"
    )


@json_command
def recover(
    run: RunArg,
    out: Path | None = opt("File for the rest of the job; FILE.rest.gcode by default."),
    from_line: int | None = opt(
        "Line of the job to continue with, instead of the checkpoint.", min=1
    ),
    yes: bool = opt("Write the file without asking.", False),
) -> None:
    """Plan how to continue after a power cut or a reset, from the last checkpoint.

    Lists the manual steps, and writes the rest of the job as a file that approaches the point
    from above. Nothing is sent to the printer.
    """
    folder = print_folder(run)
    plan = planned(folder, from_line)
    job = Path(load_record(folder).job)
    refuse_input_as_output(out, job)
    file = out or job.with_suffix(".rest.gcode")
    messages().print(
        *(f"{k}. {text}" for k, text in enumerate(plan.steps, 1)), sep="\n", markup=False
    )
    if not yes and sys.stdin.isatty():
        messages().print(f"Write {file}? Type yes: ", end="")
        yes = sys.stdin.readline().strip().lower() == "yes"
    if not yes:
        raise SafetyError(f"{file} wasn't written; answer yes, or give --yes")
    written = write_rest(folder, plan, file)
    print_result(written, [str(file), f"when all that is done: {written['command']}"])


def give_up(run: RunArg) -> None:
    """Close the journal of an interrupted print; nothing is sent to its printer.

    Afterwards the print can't be continued, and its printer can be connected again. `printctl
    recover` can still plan the rest as a separate job. If a start may still reach a network host,
    the file is deleted there.
    """
    status = give_up_print(print_folder(run), this_user()["who"] or "the user")
    print_lines(f"{state_words(status.state)}: {status.message}")


@json_command
def looks(run: RunArg) -> None:
    """List the looks at a print: what was found, decided and asked.

    Pictures, with what was expected and found drawn in, are in the print's folder, under looks.
    """
    folder = print_folder(run)
    found = _looks(folder)
    if not (found or wants_json()):
        why = _UNLOOKED if (folder / records.ORDER_FILE).is_file() else "observe is a recipe's part"
        raise UsageError(f"nobody has looked at the print in {folder}; {why}")
    print_result(
        [asdict(one) for one in found],
        lambda: [
            *(_words(one, records.read_answer(folder, one.number)) for one in found),
            *asking_lines(folder, read_print(folder).status),
        ],
    )


_UNLOOKED: Final = (
    "observe.every asked for no look before its end (a simulated printer is quicker than the "
    "clock, a part may be lower than a height gained: say `60 s written` or `layer`)"
)


def asking_lines(folder: Path, status: Status) -> list[str]:
    """What the look that the print waits at proposes, and how to answer it; none for no such."""
    looks = _looks(folder)
    last = records.look_awaiting_answer(looks, status)
    if last is None or records.read_answer(folder, last.number) is not None:
        return []
    asks = f"look {last.number} asks to {proposal_words(last)}"
    if not alive(folder, records.OBSERVER_LOCK):
        return [
            f"{asks}, but its observer is gone: `printctl resume RUN` starts another one, which "
            "asks again"
        ]
    return [
        f"{asks}: see {records.look_folder(folder, last.number)}, then `printctl observe answer "
        f"RUN approve --look {last.number}` (or go_on, stop)"
    ]


def looks_lines(run: Path) -> list[str]:
    """What came of the looks at a run's print, in a line; none for a print that isn't observed."""
    folder = run / JOURNAL_FOLDER
    if not (folder / JOURNAL).is_file():
        return []
    found = _looks(folder)
    if found:
        return [f"{total_words(found)}; `printctl observe looks {run}`"]
    return (
        [f"nobody looked at the print: {_UNLOOKED}"] if (run / records.ORDER_FILE).is_file() else []
    )


@command
def answer(
    run: RunArg,
    word: str = arg(
        "approve: do what is proposed. go_on: continue without it. stop: cancel the print."
    ),
    look: int | None = opt(
        "Number of the look to answer; refused if a later one is waiting.",
        min=1,
        show_default="the last one",
    ),
) -> None:
    """Answer the last look of a print that waits for the operator's word.

    A look asks where something is to be written (observe.mend: ask), or where no ink came: clear
    the needle first. `printctl observe looks` says what is proposed.
    """
    folder = print_folder(run)
    found = _looks(folder)
    if not found:
        raise UsageError(f"nobody has looked at the print in {folder}")
    last = found[-1].number
    if look not in (None, last):
        raise UsageError(f"look {look} isn't the last, which is look {last}; nothing was done")
    status = read_print(folder).status
    if not records.is_paused_by_look(status, last):
        raise UsageError(
            f"the print isn't waiting for an answer to look {last} "
            f"({state_words(status.state)}); nothing was done"
        )
    try:
        records.refuse_without_observer(folder)
        records.answer_look(folder, last, word)
    except ValueError as exc:
        raise UsageError(str(exc)) from exc
    print_lines(f"look {last}: {word}; `printctl status` tells what the print does")


def _words(look: records.LookRecord, word: str | None) -> str:
    share = f", {seen}" if (seen := seen_words(look)) else ""
    answered = f"; answered: {word}" if look.asked and word else ""
    return f"look {look.number} ({look.mark}){share}: {look.decision}: {look.why}{answered}"
