"""Recipe's simulated print defects: their positions in the printer's frame."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from design.network import VesselNetwork
from printctl.errors import RecipeError
from printctl.pipeline.stages.scan import scan_defects
from printctl.recipe.making import SimulatedScan

NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 1], [10, 0, 1]]), np.array([[0, 1]]), np.array([0.2]), np.zeros(1),
    np.zeros(1),
)  # fmt: skip
PLACE = np.array([60.0, 50.0, 0.5])


def ordered(*defects: dict[str, object]) -> SimulatedScan:
    return TypeAdapter(SimulatedScan).validate_python(
        {"simulated": "oct", "defects": list(defects)}
    )


def test_each_kind_lies_along_its_vessel_in_the_printers_frame() -> None:
    part = ordered(
        {"defect": "bulge", "vessel": 0, "at": 0.3, "height_um": 60, "towards": [0, 1, 0]},
        {"defect": "stenosis", "vessel": 0, "percent": 40},
        {"defect": "occlusion", "vessel": 0, "length_mm": 0.8},
        {"defect": "missing", "vessel": 0},
        {"defect": "leak", "vessel": 0, "diameter_um": 200, "to": [5, 0, 4]},
    )
    bulge, stenosis, occlusion, missing, leak = scan_defects(part.defects, NETWORK, PLACE)
    np.testing.assert_allclose(bulge.path, [[60, 50, 1.5], [70, 50, 1.5]])
    assert (bulge.at_mm, bulge.height_mm, bulge.radius_mm) == (3.0, 0.06, 0.2)
    np.testing.assert_array_equal(bulge.side, [0, 1, 0])
    assert stenosis.left == pytest.approx(0.6)
    assert occlusion.length_mm == 0.8
    assert occlusion.radius_mm > 0.2
    assert missing.kind == "missing"
    np.testing.assert_allclose(leak.path, [[65, 50, 1.5], [65, 50, 4.5]])
    assert leak.radius_mm == pytest.approx(0.1)


def test_vessel_that_isnt_there_is_refused_by_name() -> None:
    part = ordered({"defect": "missing", "vessel": 3})
    with pytest.raises(RecipeError, match="vessels 0 to 0"):
        scan_defects(part.defects, NETWORK, PLACE)


@pytest.mark.parametrize(
    "wrong",
    [
        {"defect": "crack", "vessel": 0},
        {"defect": "missing", "vessel": 0, "length_mm": 1.0},
        {"defect": "leak", "vessel": 0},
        {"defect": "stenosis", "vessel": 0, "percent": 120},
    ],
)
def test_unknown_kinds_and_keys_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ordered(wrong)


def test_no_defects_by_default() -> None:
    assert ordered().defects == ()
