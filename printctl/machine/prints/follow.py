"""Ask before a print starts; follow it from the command line; on Ctrl-C detach, cancel or halt."""

from __future__ import annotations

import math
import shlex
import signal
import sys
from collections.abc import Callable

from firmware_profiles import Ink, Syringe
from printctl.errors import PrintctlError, PrinterFailedError, SafetyError
from printctl.machine.job.retreat import Retreat
from printctl.machine.prints.words import alarm_words
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import stop_and_leave
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import read_journal_if_any
from printctl.machine.records.states import LinkState, Status, state_words
from printctl.progress import Report, StageBars

_QUESTION = """
The print continues by itself. Choose:
  d  detach: leave it printing
  c  cancel: end the print; relieve the plunger, lift the needle
  e  EMERGENCY STOP: halt the printer at once; its position is lost
  (anything else: keep watching)
> """


def confirm(port: str, bars: StageBars, assume_yes: bool) -> None:
    """Have a person say that a real machine may move now.

    A changed recipe or a new version of the product makes the print stage run again; that alone
    mustn't move a needle. Raises `SafetyError` when the answer isn't yes, or without a terminal.
    """
    if assume_yes:
        return
    answer = ""
    if sys.stdin.isatty():
        with bars.paused():
            answer = bars.ask(
                f"\nThe printer on {port} will move. Is the syringe filled, the needle touched "
                "off, and the dish in place? Type yes to start: "
            )
    if answer.strip().lower() != "yes":
        raise SafetyError(f"the print on {port} wasn't started; answer yes, or give --yes")


def follow(client: PrintClient, report: Report, bars: StageBars, goes_on: bool = True) -> Status:
    """Show progress until the print is over; on Ctrl-C ask: detach, cancel or emergency stop.

    Nothing is asked of a print that doesn't go on by itself: Ctrl-C ends it.

    Raises
    ------
    PrinterFailedError
        When the print didn't end well.
    PrintctlError
        When the user detached.
    """
    if sys.stdin.isatty():
        # A parent that ignores Ctrl-C (a shell's background job) bequeathes that.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    last = Status(LinkState.CONNECTING)
    while True:
        try:
            for status in client.events():
                _remark_news(client, bars, last, status)
                last = status
                done = status.lines_done / max(status.lines_total, 1)
                held = status.state in (LinkState.PAUSED, LinkState.LOOKING, LinkState.STOPPING)
                lines = f"{status.lines_done} of {status.lines_total} lines"
                report(done, f"{lines}; {status.message}" if held else lines)
            break
        except KeyboardInterrupt:
            if not goes_on:
                raise
            _obey(_ask(bars), client)
    outcome = client.wait()
    if outcome.state is not LinkState.DONE:
        raise PrinterFailedError(
            f"the print ended as {state_words(outcome.state)}: {outcome.message} "
            f"({outcome.lines_done} of {outcome.lines_total} lines taken by the printer; `printctl "
            f"status` tells how many are made; journal: {client.folder})"
        )
    if not outcome.proved:
        bars.remark("print", outcome.message)
    return outcome


def interrupted(bars: StageBars) -> Callable[[PrintClient], None]:
    """Return what Ctrl-C does to a print before its first lines: ask, or end it without a terminal.

    For `printctl.machine.process.clients.starting.find_or_start`.
    """

    def act(client: PrintClient) -> None:
        if not sys.stdin.isatty():
            stop_and_leave(client)
        _obey(_ask(bars), client)

    return act


def _remark_news(client: PrintClient, bars: StageBars, last: Status, status: Status) -> None:
    """Show a new alarm in words, and what a pause is for with the command that goes on."""
    if status.alarms > last.alarms:
        alarm = read_journal_if_any(client.folder / JOURNAL).last_alarm
        bars.remark("print", alarm_words(status.alarms, alarm))
    words = status.message
    paused_before = last.state is LinkState.PAUSED and last.message == words
    if status.state is LinkState.PAUSED and words and not paused_before:
        run = shlex.quote(str(client.folder.absolute()))
        go_on = "" if "printctl resume" in words else f"; `printctl resume {run}` goes on"
        bars.remark(
            "print",
            f"it waits for you: {words.replace(' RUN', f' {run}')}{go_on}. Type that in "
            f"another terminal; `printctl status {run}` tells more, and what a look asks",
        )


def retreat_for(syringe: Syringe, ink: Ink, lift_mm: float, prime_ul: float = 0.0) -> Retreat:
    """Out of the bath: relieve the plunger as the ink's profile says, then straight up.

    ``prime_ul`` is pushed in addition on coming back.
    """
    per_ul = 4 / (math.pi * syringe.inner_mm**2)
    return Retreat(
        relief_mm=ink.retract_ul * per_ul,
        relief_mm_s=ink.plunger_ul_s * per_ul,
        lift_mm=lift_mm,
        prime_mm=prime_ul * per_ul,
    )


def _ask(bars: StageBars) -> str:
    """d, c or e (earlier s and k); without a terminal the print isn't touched."""
    if not sys.stdin.isatty():
        return "d"
    try:
        with bars.paused():
            return bars.ask(_QUESTION).strip().lower()[:1]
    except KeyboardInterrupt:  # pressed again: whoever insists wants it to end, but not lost
        return "c"
    except EOFError:
        return "d"


def _obey(request: str, client: PrintClient) -> None:
    if request in ("e", "k"):
        client.kill()
    elif request in ("c", "s"):
        client.stop()
    elif request == "d":
        client.detach()
        raise PrintctlError(
            f"detached; the print goes on (journal: {client.folder}); "
            "run the same command again to watch it, or to cancel it by Ctrl-C"
        )
