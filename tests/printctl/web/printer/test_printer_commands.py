"""Manual moves, heaters, plunger and connection, with a simulated printer."""

import pytest

from firmware_profiles import Dish, load
from printctl.machine.link.errors import Refused
from printctl.machine.station import StationState
from printctl.web.errors import ConflictError, NotFoundError, NotInControlError
from printctl.web.printer.printer_commands import BLIND_LIFT_MM, CLEAR_MM
from printctl.web.printer.service import PrinterService
from tests.printctl.web.printer.conftest import ME, OTHER, wait_for


def test_without_a_printer_nothing_moves_and_the_message_says_what_to_do(
    idle: PrinterService,
) -> None:
    with pytest.raises(ConflictError, match="connect one first"):
        idle.hands.jog(ME, "x", 1.0)
    assert idle.status.state is StationState.CLOSED


def test_a_profile_that_is_not_there_is_refused_before_a_port_is_opened(
    idle: PrinterService,
) -> None:
    with pytest.raises(NotFoundError, match="marlin_avr"):
        idle.connect(ME, "no_such_printer", "simulated")


def test_a_new_server_finds_the_station_again(service: PrinterService) -> None:
    assert service.status.open
    assert service.status.profile == "generic_marlin"


def test_jog_moves_by_the_step_and_news_say_where_it_is(service: PrinterService) -> None:
    before = service.status.position_mm
    assert before is not None
    after = service.hands.jog(ME, "x", 0.1).position_mm
    assert after == pytest.approx((before[0] + 0.1, before[1], before[2]))
    wait_for(
        service,
        lambda: service.core.events.latest["station"]["position_mm"] == pytest.approx(after),
    )


def test_a_move_beyond_the_axis_is_refused_with_value_and_limit(service: PrinterService) -> None:
    with pytest.raises(Refused, match=r"-10\.00 mm is outside 0 to 200 mm"):
        service.hands.jog(ME, "x", -10.0)


def test_only_who_holds_the_controls_moves_but_anyone_stops(service: PrinterService) -> None:
    service.core.controls.take(ME)
    for refused in (
        lambda: service.hands.jog(OTHER, "x", 1.0),
        lambda: service.hands.heat(OTHER, "bed", 30.0),
        lambda: service.hands.plunger(OTHER, 1.0),
        lambda: service.hands.mount(OTHER, needle="25g"),
        lambda: service.console.send(OTHER, "M105"),
        lambda: service.guide.start(OTHER, "floor"),
        lambda: service.disconnect(OTHER),
    ):
        with pytest.raises(NotInControlError, match="the operator holds the controls"):
            refused()
    assert service.stop_motion().open


def test_out_of_the_bath_is_above_the_rim_where_that_is_known(service: PrinterService) -> None:
    lifted = service.hands.lift_out(ME).position_mm
    assert lifted is not None
    assert lifted[2] == pytest.approx(BLIND_LIFT_MM)
    service.hands.home(ME, ["z"])
    service.hands.mount(ME, needle="25g", dish="petri_60mm")
    service.guide.start(ME, "floor")
    for _ in range(3):
        service.guide.read(ME)
    service.guide.use(ME)
    up = service.hands.lift_out(ME).position_mm
    assert up is not None
    assert up[2] == pytest.approx(load(Dish, "petri_60mm").wall_mm + CLEAR_MM)
    with pytest.raises(ConflictError, match="already"):
        service.hands.lift_out(ME)


def test_homing_with_a_needle_above_a_dish_is_refused(service: PrinterService) -> None:
    service.hands.mount(ME, needle="25g", dish="petri_60mm")
    with pytest.raises(Refused, match="needle"):
        service.hands.home(ME, ["z"])
    assert service.hands.home(ME, ["z"], needle_off=True).homed[2]


def test_a_needle_put_on_is_not_trusted_until_somebody_says_where_its_tip_is(
    service: PrinterService,
) -> None:
    service.hands.home(ME, ["x", "y", "z"], needle_off=True)
    service.hands.jog(ME, "z", 30.0)
    assert not service.hands.mount(ME, needle="30g").position_trusted
    said = service.hands.set_position(ME, z=12.5)
    assert said.position_trusted
    assert said.position_mm == pytest.approx((0.0, 0.0, 12.5))
    with pytest.raises(Refused, match="200 mm"):
        service.hands.set_position(ME, z=500.0)


def test_targets_keep_within_what_the_ink_bears_and_all_go_off(service: PrinterService) -> None:
    service.hands.mount(ME, ink="collagen_fresh")
    with pytest.raises(Refused, match="temperature_c"):
        service.hands.heat(ME, "nozzle", 60.0)
    service.hands.heat(ME, "bed", 30.0)
    wait_for(service, lambda: targets(service) == [0.0, 30.0])
    service.hands.heaters_off(ME)
    wait_for(service, lambda: targets(service) == [0.0, 0.0])


def targets(service: PrinterService) -> list[float | None]:
    return [one.target_c for one in service.status.temperatures]


def test_a_needle_above_a_dish_is_to_be_touched_off(service: PrinterService) -> None:
    assert not service.status.mounted.touch_off_due
    assert service.hands.mount(ME, needle="25g", dish="petri_60mm").mounted.touch_off_due
