"""Notice flow, speed or places changed at the printer's panel, and moves slower than planned.

A factor of flow (M221) or speed (M220) set at the panel leaves no trace in places or answers: the
plunger makes its share of each move, and every line is answered as before. So the firmware is asked
for them at each checkpoint, before each return to the job's place, and at the end. Where it doesn't
tell them, the time since the last checkpoint says whether moves took longer than planned.

Not noticed: a change that is taken back before the next question and makes the moves faster.
"""

from __future__ import annotations

from typing import Final

from printctl.machine.control.board.standstill import MODEL_ERROR, is_unbounded
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.printing.context import Print
from printctl.machine.control.requests import Request
from printctl.machine.job.coordinates import modal_state
from printctl.machine.job.moves import moves_ahead, planned_s

LATE_SHARE: Final = 0.1
"""Share of the planned time by which moves may take longer: twice the plan's own error."""
LATE_S: Final = 5.0
"""And so much more: questions, answers that were late."""
MAX_LINES: Final = 3000
"""Job lines between two checkpoints whose time is planned; more would hold the line up."""
_BY_TIME_LINES: Final = 64
"""Moves ahead of a firmware that plans by time, at most."""

_FRAME_BYTES: Final = 20
"""Number, checksum and line end of a line as it is sent, and its answer."""
_BOARD_S: Final = 0.006
"""What a board takes to read and answer a line, at most (an 8-bit Marlin)."""


def notice_changes(run: Print) -> Steps[str]:
    """Take back what was changed at the panel since the last checkpoint; report it in an alarm.

    Return the alarm's text; empty where nothing was printed otherwise. Nothing is in flight.
    """
    done, since = run.progress.done, run.pace.since
    changed = yield from run.firmware.changed_at_panel()
    late = _late_words(run)
    if late or any(one.reset.startswith("M220") for one in changed):
        run.progress.standstills.lose_pace()
    run.begin_pace()
    if not changed and not late:
        return ""
    for one in changed:
        if one.reset:
            yield from run.channel.command(one.reset.encode("ascii"))
    resets = ", ".join(one.reset for one in changed if one.reset)
    words = [f"{one.what}{f': {one.remedy}' if one.remedy else ''}" for one in changed]
    what = "; ".join([*words, *([late] if late else [])])
    by_whom = ", changed at the printer's panel or by another program" if changed else ""
    back = f"; set back ({resets})" if resets else ""
    if done == since:
        run.logbook.alarm(f"{what}{by_whom} while the print was held{back}")
        return ""
    first, last = run.job.file_line(since), run.job.file_line(done)
    text = (
        f"{what}{by_whom} between line {first} and line {last} of {run.job.name}{back}; inspect "
        "what was printed there"
    )
    run.logbook.alarm(text)
    run.changes.append(text)
    return text


def pause_on_changes(run: Print) -> Steps[None]:
    """Have the print paused where anything was changed since the last checkpoint."""
    text = yield from notice_changes(run)
    if text:
        run.queue.add(Request.PAUSE, why=text)


def _late_words(run: Print) -> str:
    """Return by how much the moves since the last checkpoint took longer; '' for not, or unknown.

    The moves that were still ahead at the last checkpoint count in full, those ahead now as well.
    """
    pace, done, lines = run.pace, run.progress.done, run.job.lines
    elapsed_s = run.channel.now - pace.since_s
    ahead = min(moves_ahead(run.printer), _BY_TIME_LINES)
    first = max(pace.since - int(ahead), 0)
    noisy = run.wiring.protocol.line_errors != pace.errors
    if noisy or done == pace.since or elapsed_s <= LATE_S or not 0 < done - first <= MAX_LINES:
        return ""
    if is_unbounded(lines, first, done):
        return ""
    plan_s = planned_s(lines, first, done, modal_state(lines, first), run.printer)
    if run.firmware.tells_factors:  # else moves slowed down look like standstills
        elapsed_s -= run.logbook.stood_s(first)
    if elapsed_s <= (1.0 + MODEL_ERROR + LATE_SHARE) * max(plan_s, _wire_s(run, first)) + LATE_S:
        return ""
    return f"the moves took {elapsed_s:.0f} s, but {plan_s:.0f} s at most were planned"


def _wire_s(run: Print, first: int) -> float:
    """Return how long the lines since `first` take to be sent and answered one by one, s."""
    printer, lines = run.printer, run.job.lines[first : run.progress.done]
    bits = 10 * sum(len(line) + _FRAME_BYTES for line in lines)
    return bits / printer.baud + len(lines) * (printer.host_turnaround_s + _BOARD_S)
