"""Check embedded G-code for needle shaft contact with written ink, independently of the planner.

Goes in: an embedded job, its network, its needles. Comes out: contacts by line and vessel. Begin
with `check.py`.
"""

from sim.errors import ClearanceError
from sim.gcode.clearance.check import Clearance, ShaftContact, check_clearance
from sim.gcode.clearance.kernels import NeedleBody
from sim.gcode.clearance.motion import KINDS, LineSources, NeedleMotion, motion_of
from sim.gcode.clearance.network import DesignedOverlap, WrittenNetwork

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
