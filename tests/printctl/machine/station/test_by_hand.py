"""Manual moves of an idle simulated printer; unsafe ones refused."""

from __future__ import annotations

import threading

import pytest

from printctl.machine.link.errors import AlreadyPrinting, LinkError, Refused
from printctl.machine.station import StationState, attach, connect
from printctl.machine.station.status import StationStatus


def test_tells_where_it_stands_and_how_warm_it_is(at_rest):
    status = at_rest.status
    assert status.state is StationState.READY
    assert status.firmware.startswith("Marlin")
    assert status.position_mm == (100, 100, 50)
    assert status.position_trusted
    assert [one.name for one in status.temperatures] == ["nozzle", "bed"]
    assert status.soft_low_mm == (0, 0, 0)
    assert status.soft_high_mm == (200, 200, 200)


def test_jogs_and_goes_to_places(at_rest):
    assert at_rest.jog("x", 1.5).position_mm == (101.5, 100, 50)
    assert at_rest.jog({"y": -2, "z": 0.05}, speed_mm_s=2).position_mm == (101.5, 98, 50.05)
    assert at_rest.move_to(z=60).position_mm == (101.5, 98, 60)


def test_many_small_steps_add_up(at_rest):
    for _ in range(8):
        at_rest.jog("x", 0.005)
    assert at_rest.command("M114")[0].startswith("X:100.04 ")


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (lambda s: s.jog("x", 101), "outside 0 to 200 mm"),
        (lambda s: s.move_to(z=-1), "outside 0 to 200 mm"),
        (lambda s: s.jog("x", 1, speed_mm_s=301), "exceeds 300 mm/s"),
        (lambda s: s.jog("z", 1, speed_mm_s=6), "exceeds 5 mm/s .max_speed_mm_s.z"),
        (lambda s: s.jog("q", 1), "axis q is none of"),
        (lambda s: s.jog("x", float("nan")), "isn't a finite number|can't be read"),
        (lambda s: s.heat("bed", 60), "outside 0 to 45 °C"),
        (lambda s: s.heat("chamber", 30), "tells of no 'chamber'"),
        (lambda s: s.plunger(1), "which syringe"),
        (lambda s: s.command("G92 X0"), "isn't for manual use"),
        (lambda s: s.command("G1 Z-5"), "outside 0 to 200 mm"),
        (lambda s: s.command("M140 S90"), "outside 0 to 45 °C"),
        (lambda s: s.mount(needle="no_such"), "no_such"),
        (lambda s: s.mount(hat="bowler"), "'hat' can't be mounted"),
        (lambda s: s.set_position(x=-5), "no tip stands there"),
        (lambda s: s.set_position(), "no axis is given"),
        (lambda s: s.touch_off(), "say which first"),
        (lambda s: s.reconnect(), "is connected"),
    ],
)
def test_refusal_says_why_and_moves_nothing(at_rest, asked, why):
    with pytest.raises(Refused, match=why):
        asked(at_rest)
    status = at_rest.status
    assert status.state is StationState.READY
    assert status.position_mm == (100, 100, 50)


def test_homing_needs_the_needle_off(at_rest):
    at_rest.mount(needle="25g", dish="petri_60mm")
    with pytest.raises(
        Refused,
        match=r"needle .25G, half an inch. mounted above the dish",
    ):
        at_rest.home()
    with pytest.raises(Refused, match="would drive it"):
        at_rest.command("G28 Z")
    status = at_rest.home(("x", "y"), needle_off=True)
    assert status.position_mm is not None
    assert status.position_mm[:2] == (0, 0)
    assert status.mounted.needle == ""


def test_floor_is_touched_off_and_then_held(at_rest):
    at_rest.mount(needle="25g", dish="petri_60mm", dish_centre_mm=(100, 100))
    at_rest.set_position(z=4)
    with pytest.raises(Refused, match="isn't touched off"):
        at_rest.jog("z", -2)
    at_rest.jog("z", -1)
    status = at_rest.touch_off(foil_mm=0.5)
    assert status.mounted.floor_mm == 2.5
    assert status.soft_low_mm[2] == pytest.approx(2.5, abs=1e-4)
    with pytest.raises(Refused, match=r"below the dish's floor, touched off at 2.50 mm"):
        at_rest.jog("z", -0.6)
    assert at_rest.set_position(z=0.5).mounted.floor_mm == 0
    with pytest.raises(Refused, match="of the wall of"):
        at_rest.jog("x", 40)
    assert at_rest.mount(needle="27g").mounted.floor_mm is None


def test_plunger_goes_by_microlitres_within_its_syringe(at_rest):
    at_rest.mount(syringe="bd_1ml", ink="gelatin_sacrificial", plunger_mm=50)
    status = at_rest.plunger(2)
    assert status.ul_left is not None
    full = at_rest.mount(plunger_mm=50).ul_left
    assert full is not None
    assert full - status.ul_left == pytest.approx(2, abs=0.01)
    with pytest.raises(Refused, match="that are left in bd_1ml"):
        at_rest.plunger(full + 1)
    with pytest.raises(Refused, match="counts as full there"):
        at_rest.plunger(-1000)
    with pytest.raises(Refused, match="plunger_ul_s of"):
        at_rest.plunger(1, ul_s=50)
    for _ in range(5):
        at_rest.plunger(0.1)
    left = at_rest.plunger(-0.5).ul_left
    assert left == pytest.approx(full, abs=1e-6)


def test_heater_is_set_and_told(at_rest):
    at_rest.heat("bed", 37)
    for status in at_rest.events():
        if {one.name: one.target_c for one in status.temperatures}["bed"] == 37:
            break
    at_rest.heat("bed", 0)


def test_every_listener_hears_and_a_dead_one_doesnt_matter(at_rest):
    dead = at_rest.events()
    next(dead)
    other = attach(at_rest.folder)
    heard: list[StationStatus] = []
    listening = threading.Event()

    def listen() -> None:
        for status in other.events():
            heard.append(status)
            listening.set()

    thread = threading.Thread(target=listen)
    thread.start()
    assert listening.wait(10)
    at_rest.jog("y", 1)
    other.detach()
    thread.join(10)
    assert not thread.is_alive()
    assert StationState.BUSY in [status.state for status in heard]
    assert at_rest.jog("y", -1).position_mm == (100, 100, 50)


def test_second_station_in_the_folder_is_refused(at_rest, monkeypatch):
    monkeypatch.setattr("printctl.machine.link.find_link._ENDING_S", 0.1)
    with pytest.raises(AlreadyPrinting, match="at 0 times real time, not 30; attach"):
        connect("generic_marlin", "simulated", at_rest.folder, sim_speed=30)


def test_wrong_profile_or_port_is_said(folder, profile):
    with pytest.raises(LinkError, match="/dev/nowhere doesn't exist"):
        connect(profile, "/dev/nowhere", folder)
    status = attach(folder).status
    assert status.state is StationState.LOST
    assert "/dev/nowhere" in status.message
