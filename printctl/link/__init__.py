"""Print a G-code job from a process of its own: streaming, journal, pause, stop, recovery, client.

Goes in: a job's file, a port, a profile. Comes out: a printed job, its journal, events to clients.
Begin with `process.py`.
"""

from printctl.link.care import Care, NewSyringe
from printctl.link.client import PrintClient, attach, resume_print, start_print
from printctl.link.errors import LinkError
from printctl.link.marks import MarkKind
from printctl.link.ports import PortInfo, list_ports
from printctl.link.retreat import Retreat
from printctl.link.states import LinkState, PrintOutcome, Status

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
