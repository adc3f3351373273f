"""Predict the ink that executed motion deposits in the bath.

From the plunger's motion to the flow out of the needle (`flow`), from there to what lies where
(`predict`), and what bath and needle do with it (`bath`, `drag`). Each says what it models, by
which source, and which of its constants were never measured.

Goes in: executed motion, an ink, a needle. Comes out: where ink lies, and how thick. Begin with
`predict.py`.
"""

from sim.gcode.bead.flow import (
    Advance,
    Nozzle,
    NozzleFlow,
    Pieces,
    advance_of,
    cut,
    nozzle_flow,
    nozzle_of,
)
from sim.gcode.bead.predict import (
    Bead,
    Drag,
    FilamentHold,
    Trail,
    bead_deposit,
    crevice,
    drag,
    predict_bead,
    settling,
    swell,
)

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
