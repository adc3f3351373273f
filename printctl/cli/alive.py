"""`printctl alive`: restart a print's dead-man timer; confirms that an operator is present."""

from __future__ import annotations

from printctl.cli.options import print_lines
from printctl.cli.run_folder import RunArg, running_print


def alive(run: RunArg) -> None:
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
