"""Check embedded G-code for needle shaft contact with written ink, independently of the planner.

Goes in: an embedded job, its network, its needles. Comes out: contacts by line and vessel. Begin
with `check.py`.
"""

from sim.errors import ClearanceError
from sim.gcode.clearance.check import check_clearance
from sim.gcode.clearance.contact import ShaftContact
from sim.gcode.clearance.heads import KINDS
from sim.gcode.clearance.joints import DesignedOverlap
from sim.gcode.clearance.motion import LineSources, NeedleMotion, motion_of
from sim.gcode.clearance.needle import NeedleBody
from sim.gcode.clearance.network import WrittenNetwork
from sim.gcode.clearance.result import Clearance

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
