"""Print a G-code job from a process of its own: streaming, journal, pause, stop, recovery, client.

Goes in: a job's file, a port, a profile. Comes out: a printed job, its journal, events to clients.
Begin with `process.py`.
"""

from printctl.machine.link.care import Care, NewSyringe
from printctl.machine.link.client import PrintClient, attach, resume_print, start_print
from printctl.machine.link.errors import LinkError
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.ports import PortInfo, list_ports
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, PrintOutcome, Status

__all__ = [
    "Care",
    "LinkError",
    "LinkState",
    "MarkKind",
    "NewSyringe",
    "PortInfo",
    "PrintClient",
    "PrintOutcome",
    "Retreat",
    "Status",
    "attach",
    "list_ports",
    "resume_print",
    "start_print",
]
