"""Predict the ink that executed motion deposits in the bath.

From the plunger's motion to the flow out of the needle (`flow`), from there to what lies where
(`predict`), and what bath and needle do with it (`bath`, `drag`). Each says what it models, by
which source, and which of its constants nobody measured.

Goes in: executed motion, an ink, a needle. Comes out: where ink lies, and how thick. Begin with
`predict.py`.
"""

from sim.gcode.bead.advance import Advance, advance_of
from sim.gcode.bead.bath import FilamentHold, Trail, crevice, settling, swell
from sim.gcode.bead.drag import Drag, drag
from sim.gcode.bead.flow import NozzleFlow, nozzle_flow
from sim.gcode.bead.nozzle import Nozzle, nozzle_of
from sim.gcode.bead.pieces import Pieces, cut
from sim.gcode.bead.predict import Bead, predict_bead
from sim.gcode.bead.voxels import bead_deposit

__all__ = [
    "Advance",
    "Bead",
    "Drag",
    "FilamentHold",
    "Nozzle",
    "NozzleFlow",
    "Pieces",
    "Trail",
    "advance_of",
    "bead_deposit",
    "crevice",
    "cut",
    "drag",
    "nozzle_flow",
    "nozzle_of",
    "predict_bead",
    "settling",
    "swell",
]
