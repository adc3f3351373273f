"""`printctl stop` and `printctl kill`: end a print by a controlled stop, or halt it by M112."""

from __future__ import annotations

from typing import Final

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, print_folder, running_print
from printctl.machine.link.client import attach
from printctl.machine.link.errors import LinkError
from printctl.machine.link.kill import UNCONFIRMED
from printctl.machine.link.states import LinkState, PrintOutcome

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
