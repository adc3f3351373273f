"""The way from one well's part to the next."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath.wells import Trip, with_approach


@pytest.mark.parametrize(("begins", "ends"), [(6.0, 1.0), (1.0, 6.0)])
def test_a_way_below_one_of_its_ends_is_refused(begins: float, ends: float) -> None:
    part: Any = SimpleNamespace(start=np.array([[9.0, 0.0, ends]]))
    with pytest.raises(ToolpathError, match=r"at 5 mm and begins or ends at 6 mm"):
        with_approach(part, np.array([0.0, 0.0, begins]), Trip(5.0, 10.0, 0.1, 1.0))
