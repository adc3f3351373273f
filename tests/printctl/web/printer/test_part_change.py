"""Syringe or needle change on the Printer page."""

import pytest

from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.part_change import PURGE_STEP_UL, PURGE_UL
from printctl.web.printer.service import PrinterService
from tests.printctl.web.printer.conftest import ME


def test_more_than_a_syringe_holds_is_refused(service: PrinterService) -> None:
    with pytest.raises(BadRequestError, match="1000"):
        service.changing.syringe(ME, "hamilton_1ml", "", 1500.0)


def test_a_purge_is_slow_small_and_limited_in_all(service: PrinterService) -> None:
    before = service.changing.syringe(ME, "hamilton_1ml", "collagen_fresh", 1000.0).ul_left
    with pytest.raises(BadRequestError, match="at most 5"):
        service.changing.purge(ME, 20.0)
    with pytest.raises(BadRequestError, match=r"at most at 0\.4 µL/s"):
        service.changing.purge(ME, 1.0, 4.0)
    for _ in range(int(PURGE_UL / PURGE_STEP_UL)):
        status = service.changing.purge(ME, PURGE_STEP_UL)
    assert before is not None
    assert status.ul_left == pytest.approx(before - PURGE_UL, abs=0.1)
    with pytest.raises(ConflictError, match="clog"):
        service.changing.purge(ME, 1.0)
    service.changing.syringe(ME, "hamilton_1ml", "collagen_fresh", 1000.0)
    assert service.changing.purged_ul == 0


def test_another_needle_forgets_floor_and_bath(service: PrinterService) -> None:
    service.hands.mount(ME, needle="25g", dish="petri_60mm", bath_level_mm=9.0)
    service.guide.start(ME, "floor")
    for _ in range(3):
        service.guide.read(ME)
    service.guide.use(ME)
    status = service.changing.needle(ME, "30g")
    assert status.mounted.needle == "30g"
    assert status.mounted.floor_mm is None
    assert status.mounted.bath_level_mm is None
