"""Check embedded G-code for needle shaft contact with written ink, independently of the planner.

Goes in: an embedded job, its network, its needles. Comes out: contacts by line and vessel. Begin
with `check.py`.
"""

from sim.clearance.check import check_clearance
from sim.clearance.contact import ShaftContact
from sim.clearance.heads import KINDS
from sim.clearance.joints import DesignedOverlap
from sim.clearance.motion import LineSources, NeedleMotion, motion_of
from sim.clearance.needle import NeedleBody
from sim.clearance.network import WrittenNetwork
from sim.clearance.result import Clearance
from sim.errors import ClearanceError

__all__ = [
    "KINDS",
    "Clearance",
    "ClearanceError",
    "DesignedOverlap",
    "LineSources",
    "NeedleBody",
    "NeedleMotion",
    "ShaftContact",
    "WrittenNetwork",
    "check_clearance",
    "motion_of",
]
