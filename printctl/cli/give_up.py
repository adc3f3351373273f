"""`printctl give-up`: mark an interrupted print as ended, so that its printer can be used again."""

from __future__ import annotations

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, print_folder
from printctl.machine.link.history_entry import this_user
from printctl.machine.print_state.give_up import give_up as give_up_print


def give_up(run: RunArg) -> None:
    """Write the end of a print that was broken off into its journal; nothing is sent.

    Afterwards it can't be gone on with, and its printer may be connected anew. `printctl recover`
    can still plan the rest as a job of its own.
    """
    status = give_up_print(print_folder(run), this_user()["who"] or "the user")
    print_lines(f"{status.state.value}: {status.message}")
