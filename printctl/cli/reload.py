"""`printctl reload`: change the syringe in mid-print."""

from __future__ import annotations

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, running_print
from printctl.link.pausing import CHANGE
from printctl.link.states import LinkState


def reload(run: RunArg) -> None:
    """Hold a print at its next reload point, with room above the needle to change the syringe.

    A print that is paused already stays where it is, and the needle goes up further.
    """
    with running_print(run) as client:
        here = client.status.state is LinkState.PAUSED
        client.reload()
        where = "here" if here else "at the next reload point"
        print_lines(f"will make room {where}; then {CHANGE.replace('RUN', str(run))}")
