"""`printctl status`: show a print's state and the actions it allows."""

from __future__ import annotations

import shlex

from printctl.cli.observe_looks import asking_lines
from printctl.cli.options import JsonFlag, print_json, print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.machine.link.states import Status
from printctl.machine.print_state.actions import Possible, PrintAction
from printctl.machine.print_state.state import PrintTruth, read_print
from printctl.machine.printing.print_words import alarm_words

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
