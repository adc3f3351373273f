"""Touch-off: three readings must agree."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.service import PrinterService
from printctl.web.printer.touch_off import SPREAD_MM, Touching
from tests.printctl.web.printer.conftest import ME


@given(st.lists(st.floats(-100, 100), max_size=8))
def test_readings_agree_only_when_the_last_three_are_close(readings: list[float]) -> None:
    touching = Touching("floor", 0.0, tuple(readings))
    last = readings[-3:]
    close = len(last) == 3 and max(last) - min(last) <= SPREAD_MM + 1e-9
    assert touching.agrees == close
    assert (touching.height_mm is not None) == close


def test_floor_is_the_middle_reading_less_the_foil(service: PrinterService) -> None:
    service.hands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "floor", foil_mm=0.02)
    service.hands.jog(ME, "z", 0.5)
    service.guide.read(ME)
    with pytest.raises(ConflictError, match="1 of 3 readings"):
        service.guide.use(ME)
    for step in (0.02, 0.02):
        service.hands.jog(ME, "z", step)
        touching = service.guide.read(ME)
    assert touching.agrees
    status = service.guide.use(ME)
    assert status.mounted.floor_mm == pytest.approx(0.52 - 0.02, abs=1e-6)
    assert service.guide.touching is None


def test_readings_that_scatter_are_not_used(service: PrinterService) -> None:
    service.hands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "bath")
    for _ in range(3):
        service.hands.jog(ME, "z", 0.1)
        service.guide.read(ME)
    with pytest.raises(ConflictError, match="don't agree"):
        service.guide.use(ME)
    service.guide.read(ME)
    service.guide.read(ME)
    status = service.guide.use(ME)
    assert status.mounted.bath_level_mm == pytest.approx(0.3, abs=1e-6)


def test_a_guide_wants_needle_and_dish_and_a_foil_that_is_one(service: PrinterService) -> None:
    with pytest.raises(ConflictError, match="needle and dish"):
        service.guide.start(ME, "floor")
    with pytest.raises(BadRequestError, match="0 to 2 mm"):
        service.guide.start(ME, "floor", foil_mm=3.0)
    with pytest.raises(ConflictError, match="start it first"):
        service.guide.read(ME)
