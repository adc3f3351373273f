"""OCT of melted-out ink: dark lumens in gel that fills the field."""

from dataclasses import replace

import numpy as np
import pytest

from gcode.deposit.lay import Deposit
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing

STILL = Placing(0.0, 0.0, 0.0, 0.3, (1.0, 1.0, 1.0))


def test_melted_out_ink_is_dark_in_bright_gel() -> None:
    bar = np.full((12, 40, 40), 255, np.uint8)
    ink = Deposit(bar, np.zeros(3), 0.03, "embedded", 0.0, 0.0)
    options = OctOptions(placing=STILL, ink="lumen")
    lumen = simulate_oct(ink, options, 1).volume
    gel = simulate_oct(ink, replace(options, ink="gel"), 1).volume
    z, y, x = (size // 2 for size in lumen.shape)
    middle = np.s_[z - 3 : z + 3, y - 5 : y + 5, x - 5 : x + 5]
    corner = np.s_[z - 3 : z + 3, :5, :5]
    assert lumen[corner].mean() > 20 * lumen[middle].mean()
    assert gel[middle].mean() > 20 * gel[corner].mean()


@pytest.mark.parametrize("roll_off_mm", [6.0, 1000.0])
def test_at_its_reach_gel_is_as_bright_as_noise(roll_off_mm: float) -> None:
    options = OctOptions(roll_off_mm=roll_off_mm)
    depth = options.reach_mm
    lost = 2 * options.attenuation_mm * depth + (depth / roll_off_mm) ** 2
    assert lost == pytest.approx(np.log(10) * options.signal_db / 10)
