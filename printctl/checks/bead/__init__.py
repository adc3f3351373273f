"""Predict the ink that a G-code job deposits; write tables, plots, voxels and a playback page.

Goes in: a simulated G-code file and an ink. Comes out: predicted ink as tables, pictures, voxels.
Begin with `predict.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.checks.bead.files import PLAYED, OutputFiles, write_prediction
    from printctl.checks.bead.predict import (
        InkPrediction,
        lag_of,
        predict_job,
        written_filaments,
    )
    from printctl.checks.bead.vessels import VesselDiameters, merge_bundles, vessel_diameters
    from printctl.checks.bead.warn import prediction_facts, prediction_lines

__all__ = [
    "PLAYED",
    "InkPrediction",
    "OutputFiles",
    "VesselDiameters",
    "lag_of",
    "merge_bundles",
    "predict_job",
    "prediction_facts",
    "prediction_lines",
    "vessel_diameters",
    "write_prediction",
    "written_filaments",
]

__getattr__, __dir__ = on_demand(__name__)
