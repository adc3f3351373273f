"""Commands to a print that runs or has ended: status, stop, pause, resume, recover and so on."""

from __future__ import annotations

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Final

from printctl.cli.declare import command
from printctl.cli.observe_looks import asking_lines
from printctl.cli.options import JsonFlag, messages, print_json, print_lines, refuse_input_as_output
from printctl.cli.run_folder import RunArg, print_folder, running_print
from printctl.errors import SafetyError, UsageError
from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.find_link import alive
from printctl.machine.link.history_entry import this_user
from printctl.machine.link.kill import UNCONFIRMED
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.record import load_record
from printctl.machine.link.states import LinkState, PrintOutcome, Status
from printctl.machine.link.syringe_change import CHANGE
from printctl.machine.print_state.actions import Possible, PrintAction
from printctl.machine.print_state.give_up import give_up as give_up_print
from printctl.machine.print_state.state import PrintTruth, read_print
from printctl.machine.printing.print_words import alarm_words
from printctl.machine.printing.recovery import planned, write_rest
from printctl.observe.continue_print import continue_print
from printctl.observe.records import OBSERVER_LOCK
from printctl.settings import opt

_COMMANDS = {
    PrintAction.GO_ON: "go on: printctl resume {run}",
    PrintAction.RECOVER: "recover: printctl recover {run}",
    PrintAction.GIVE_UP: "give up: printctl give-up {run}",
}


def status(run: RunArg, as_json: JsonFlag = False) -> None:
    """Say how a print stands, whether it goes on, is paused or has ended, and what may be done.

    Only looks: the print isn't touched, and of one that has ended the journal tells.
    """
    folder = print_folder(run)
    state = read_print(folder)
    if as_json:
        print_json(state.to_dict())
        return
    print_lines(*status_lines(state, str(run)), *asking_lines(folder, state.status))


def status_lines(truth: PrintTruth, run: str) -> list[str]:
    """A print for people."""
    status = truth.status
    lines = [
        f"{status.state.value}: {status.message}",
        f"{truth.words['made']}; {status.lines_done} of {status.lines_total} lines taken, "
        f"line {status.file_line} of the file",
        *(truth.words[key] for key in ("time", "layer", "vessel", "ink") if truth.words[key]),
        *waiting_lines(status),
    ]
    if status.line_errors:
        lines.append(f"{status.line_errors} lines sent again")
    if status.alarms:
        lines.append(alarm_words(status.alarms, truth.journal.last_alarm))
    if not status.position_known:
        lines.append("position unknown")
    if status.ended:
        lines += [text for one in truth.actions if (text := _offered(one, run))]
    return lines


def waiting_lines(status: Status) -> list[str]:
    """Say what a print waits for and what the machine reads."""
    lines = [f"waits for: {status.waits_for}"] if status.waits_for else []
    if status.deadman_left_s is not None and not status.ended:
        lines.append(
            f"dead-man: pauses or stops in {status.deadman_left_s / 60:.1f} min unless "
            "`printctl alive` confirms"
        )
    return lines + [f"reads {reading}" for reading in status.readings]


def _offered(one: Possible, run: str) -> str:
    """The command of an action that is possible now."""
    if not one.possible or one.action not in _COMMANDS:
        return ""
    command = _COMMANDS[one.action].format(run=shlex.quote(run))
    if one.needs != "from_line":
        return command
    if not one.from_line:
        return f"recover: {one.reason} (printctl recover --help)"
    return f"{command} --from-line {one.from_line} ({one.reason})"


# `printctl stop` and `printctl kill`: end a print by a controlled stop, or halt it by M112.

STOP_S: Final = 20.0
"""Longest wait for the end of a controlled stop; the line in flight may take longer."""
HALT_S: Final = 10.0
"""Longest wait for the printer's word that it has halted."""


def stop(run: RunArg) -> None:
    """End a print: relieve the plunger, lift the needle straight up, switch the heaters off.

    The position stays known, and `printctl recover RUN` goes on with the rest. To halt the printer
    at once there is `printctl kill`.
    """
    with running_print(run) as client:
        client.stop()
        try:
            outcome = client.wait(STOP_S)
        except TimeoutError:
            status = client.status
            print_lines(
                f"a stop is asked for, and isn't over after {STOP_S:.0f} s; now {status.state}: "
                f"{status.message}; `printctl status {run}` tells how it ends"
            )
            return
    print_lines(f"{outcome.state}: {outcome.message}")


def kill(run: RunArg) -> None:
    """Halt the printer of a print past all queues, whatever it does; its position is lost.

    A Marlin with emergency parser gets M410 first and M112 after 1.8 s; others M112 at once.
    Where the print's own process is gone, the print's port is opened and the halt written to it.
    Look at the machine afterwards and reset it; `printctl recover RUN` plans the rest.
    """
    with attach(print_folder(run)) as client:
        over = bool(client.record.status)
        client.kill()
        try:
            outcome = client.wait(HALT_S)
        except TimeoutError:
            raise LinkError(
                f"the link process of {client.folder} hasn't said within {HALT_S:.0f} s that the "
                "printer has halted: cut the printer's power"
            ) from None
    unconfirmed = UNCONFIRMED in outcome.message
    if unconfirmed and not over:
        raise LinkError(outcome.message)
    if unconfirmed or (outcome.state is not LinkState.KILLED and not outcome.position_known):
        from printctl.machine.link.kill_unlinked import (
            kill_unlinked,  # the link itself: slow to import
        )

        outcome = PrintOutcome.of(kill_unlinked(client.folder))
    before = "" if outcome.state is LinkState.KILLED else "not halted, for the print had ended: "
    print_lines(f"{before}{outcome.state.value}: {outcome.message}")


# `printctl pause`: pause a print now, or after the present layer or vessel.


class PauseAfter(StrEnum):
    """What is to be finished first."""

    LAYER = "layer"
    VESSEL = "vessel"


@command
def pause(
    run: RunArg,
    after: PauseAfter | None = opt("Finish the current layer or vessel first."),
    now: bool = opt("After the line in flight; the default.", False),
) -> None:
    """Hold a print: relieve the plunger, lift the needle straight up, keep the temperatures.

    `printctl resume RUN` comes back to the same point and goes on.
    """
    if now and after:
        raise UsageError("--now and --after exclude each other; give one")
    with running_print(run) as client:
        if client.status.state is LinkState.PAUSED:
            print_lines(f"is paused already; `printctl resume {run}` goes on")
            return
        client.pause(MarkKind(after.value) if after else None)
        held = "after the line in flight and the moves that the printer holds"
        where = f"at the end of this {after.value}" if after else held
        print_lines(f"will pause {where}; `printctl status {run}` tells when")


# `printctl resume`: resume a print that is paused, or whose link process died.


@command
def resume(
    run: RunArg,
    syringe: str | None = opt("Profile of the syringe that was put in."),
    plunger_mm: float | None = opt(
        "Travel that its plunger has used up already; 0 for a full one.", min=0.0
    ),
    unchanged: bool = opt("The syringe wasn't changed after all.", False),
    port: str | None = opt("When the printer's port has another name now."),
    unobserved: bool = opt(
        "Start no observer for a print with looks: each look pauses it after its limit.", False
    ),
) -> None:
    """Go on: come down where the print was left, prime, verify the position, print.

    After the link process died or lost its port, the printer is asked for its last line first. An
    observed print whose observer is gone gets another one first.
    """
    if unchanged and (syringe is not None or plunger_mm is not None):
        raise UsageError("--unchanged excludes --syringe and --plunger-mm")
    folder = print_folder(run)
    with attach(folder) as attached:
        ended = attached.status.ended
    unheard = not (unobserved or alive(folder, OBSERVER_LOCK))
    status = continue_print(
        folder,
        port=port,
        syringe=syringe,
        plunger_mm=plunger_mm,
        unchanged=unchanged,
        unobserved=unobserved,
    )
    if status.ended and status.state is not LinkState.DONE:
        raise LinkError(f"not gone on with: {status.message}")
    if unheard and (asking := asking_lines(folder, status)):
        print_lines(
            "another observer is at work, and the print stays paused for an answer", *asking
        )
        return
    where = "from the printer's last line" if ended else f"`printctl status {run}` tells how"
    print_lines(f"going on; {where}")


@command
def reload(
    run: RunArg,
    head: int | None = opt("Of several, whose; the one in use if not.", min=0),
) -> None:
    """Hold a print at its next reload point, with room above the needle to change the syringe.

    A print that is paused already stays where it is, and the needle goes up further.
    """
    with running_print(run) as client:
        here = client.status.state in (LinkState.PAUSED, LinkState.LOOKING)
        client.reload(head)
        where = "here" if here else "at the next reload point"
        print_lines(f"will make room {where}; then {CHANGE.replace('RUN', str(run))}")


def confirm_presence(run: RunArg) -> None:
    """Begin the dead-man's time of a print anew (`printctl print --deadman`).

    Whoever stands at the printer says so by it; without it the print pauses, or stops, in time.
    """
    with running_print(run) as client:
        client.alive()
        left = client.status.deadman_left_s
    if left is None:
        print_lines("heard; this print has no dead-man's time")
    else:
        print_lines(f"heard; confirm again within {left / 60:.1f} min")


# `printctl recover`: write G-code for the rest of a print whose printer has lost its position.


@command
def recover(
    run: RunArg,
    out: Path | None = opt("File for the rest of the job; FILE.rest.gcode by default."),
    from_line: int | None = opt(
        "Line of the job to go on with, in place of the checkpoint.", min=1
    ),
    yes: bool = opt("Write the file without asking.", False),
    as_json: JsonFlag = False,
) -> None:
    """Plan how to go on after a power cut or a reset, from the last checkpoint.

    Tells what has to be done by hand, and writes the rest of the job as a file that comes to the
    point from above. Nothing is sent to the printer.
    """
    folder = print_folder(run)
    plan = planned(folder, from_line)
    job = Path(load_record(folder).job)
    refuse_input_as_output(out, job)
    file = out or job.with_suffix(".rest.gcode")
    messages().print(
        *(f"{k}. {text}" for k, text in enumerate(plan.steps, 1)), sep="\n", markup=False
    )
    _confirm(file, yes)
    written = write_rest(folder, plan, file)
    if as_json:
        print_json(written)
        return
    print_lines(str(file), f"when all that is done: {written['command']}")


def _confirm(file: Path, assume_yes: bool) -> None:
    if assume_yes:
        return
    answer = ""
    if sys.stdin.isatty():
        messages().print(f"Write {file}? Type yes: ", end="")
        answer = sys.stdin.readline()
    if answer.strip().lower() != "yes":
        raise SafetyError(f"{file} wasn't written; answer yes, or give --yes")


def give_up(run: RunArg) -> None:
    """Write the end of a print that was broken off into its journal; nothing is sent.

    Afterwards it can't be gone on with, and its printer may be connected anew. `printctl recover`
    can still plan the rest as a job of its own.
    """
    status = give_up_print(print_folder(run), this_user()["who"] or "the user")
    print_lines(f"{status.state.value}: {status.message}")
