"""`printctl status`: how a print stands."""

from __future__ import annotations

from printctl.cli.options import JsonFlag, print_json, print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.link.client import attach
from printctl.link.states import Status


def status(run: RunArg, as_json: JsonFlag = False) -> None:
    """Say how a print stands, whether it goes on, is paused or has ended.

    Only looks: the print isn't touched, and of one that has ended the journal tells.
    """
    with attach(print_folder(run)) as client:
        found = client.status
    if as_json:
        print_json(found.to_dict())
        return
    print_lines(*told(found))


def told(status: Status) -> list[str]:
    """A status for people."""
    share = 100 * status.lines_done / max(status.lines_total, 1)
    lines = [
        f"{status.state.value}: {status.message}",
        f"{status.lines_done} of {status.lines_total} lines ({share:.1f} %), "
        f"line {status.file_line} of the file",
    ]
    if status.waits_for:
        lines.append(f"waits for: {status.waits_for}")
    if status.deadman_left_s is not None and not status.ended:
        lines.append(
            f"dead-man: pauses or stops in {status.deadman_left_s / 60:.1f} min unless "
            "`printctl alive` confirms"
        )
    lines += [f"reads {reading}" for reading in status.readings]
    if status.line_errors or status.alarms:
        lines.append(f"{status.line_errors} lines sent again, {status.alarms} alarms")
    if not status.position_known:
        lines.append("position unknown: see `printctl recover`")
    return lines
