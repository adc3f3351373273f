"""Manual moves of an idle simulated printer; unsafe ones refused."""

from __future__ import annotations

import json
import threading

import pytest

from printctl.machine.link.errors import AlreadyPrinting, Refused
from printctl.machine.station import StationState, attach, connect
from printctl.machine.station.status import StationStatus
from tests.printctl.cli.shell import Shell


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
    with pytest.raises(Refused, match=r"needle .25G, half an inch. mounted above the dish"):
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


# --- `printctl station` from the command line: connect, query, move
@pytest.fixture
def shell(monkeypatch, capsys, at_rest):
    inner = Shell(monkeypatch, capsys, "station")

    def run(*command: str) -> tuple[int, str, str]:
        return inner(*command, "--folder", str(at_rest.folder))

    return run


def test_moves_and_tells(shell):
    code, out, _ = shell("jog", "--x", "2", "--z", "-1", "--json")
    assert code == 0
    assert json.loads(out)["position_mm"] == [102, 100, 49]
    assert "tip at X100.00 Y100.00 Z49.00" in shell("jog", "--to", "--x", "100")[1]
    code, out, _ = shell("status")
    assert out.startswith("ready: ")
    assert "nozzle 21" in out


def test_says_what_is_mounted_and_pushes(shell):
    out = shell("mount", "--syringe", "bd_1ml", "--needle", "25g", "--dish-centre", "100,100")[1]
    assert "mounted: needle 25g, syringe bd_1ml" in out
    before = json.loads(shell("status", "--json")[1])["ul_left"]
    after = json.loads(shell("push", "--ul", "1", "--json")[1])["ul_left"]
    assert before - after == pytest.approx(1, abs=0.01)


def test_sends_a_line_and_gives_the_reply(shell):
    code, out, _ = shell("send", "M114")
    assert (code, out[:8]) == (0, "X:100.00")


def test_touches_off_and_counts_anew(shell):
    shell("mount", "--needle", "25g", "--dish", "petri_60mm")
    assert "floor of the dish at Z 49.90 mm" in shell("touch-off", "--foil", "0.1")[1]
    assert "floor of the dish at Z 0.00 mm" in shell("where", "--z", "0.1")[1]


@pytest.mark.parametrize(
    ("command", "code", "why"),
    [
        (("jog", "--x", "200"), 1, "outside 0 to 200 mm"),
        (("jog",), 2, "no axis is named"),
        (("mount",), 2, "nothing is named"),
        (("mount", "--dish-centre", "middle"), 2, "isn't X,Y in mm"),
        (("heat", "bed", "90"), 1, "outside 0 to 45 °C"),
        (("send", "M112"), 1, "isn't for manual use"),
        (("reconnect",), 1, "is connected"),
    ],
)
def test_refusal_is_one_line_and_an_exit_code(shell, command, code, why):
    found, _, said = shell(*command)
    assert found == code
    assert why in " ".join(said.split())


def test_without_a_station_it_says_so(monkeypatch, capsys, tmp_path):
    code, _, said = Shell(monkeypatch, capsys, "station")("status", "--folder", str(tmp_path))
    assert code == 1
    assert "connect first" in said
