"""A print as the command line sees it: start or find it, follow it, be asked when interrupted."""

from printctl.printing.simulated import SIMULATED, simulated_printer
from printctl.printing.watch import confirm, follow, retreat_for, running, start_or_attach

__all__ = [
    "SIMULATED",
    "confirm",
    "follow",
    "retreat_for",
    "running",
    "simulated_printer",
    "start_or_attach",
]
