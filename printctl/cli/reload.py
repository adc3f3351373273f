"""`printctl reload`: pause a print at its next reload point for a new syringe."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, running_print
from printctl.machine.link.states import LinkState
from printctl.machine.link.syringe_change import CHANGE


def reload(
    run: RunArg,
    head: Annotated[
        int | None, typer.Option("--head", help="Of several, whose; the one in use if not.", min=0)
    ] = None,
) -> None:
    """Hold a print at its next reload point, with room above the needle to change the syringe.

    A print that is paused already stays where it is, and the needle goes up further.
    """
    with running_print(run) as client:
        here = client.status.state in (LinkState.PAUSED, LinkState.LOOKING)
        client.reload(head)
        where = "here" if here else "at the next reload point"
        print_lines(f"will make room {where}; then {CHANGE.replace('RUN', str(run))}")
