"""Print on a station's open port, and return to standby."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.machine.link import LinkState
from printctl.machine.link.client import attach as attach_print
from printctl.machine.link.errors import JobError, Refused
from printctl.machine.link.retreat import Retreat
from printctl.machine.printing.executed_note import is_complete_record
from printctl.machine.printing.find import Order, find_or_start
from printctl.machine.station import Station, StationState


def write_job(path: Path, moves: int, start: tuple[float, float, float]) -> Path:
    x, y, z = start
    lines = ["G21", "G90", "M82", "M302 P1", f"G92 X{x} Y{y} Z{z} E0", f"G1 Z{z - 1} F300"]
    for number in range(1, moves + 1):
        lines.append(
            f"G1 X{x + number % 7 * 0.5} Y{y + number % 5 * 0.5} E{number * 0.01:.3f} F600"
        )
    path.write_text("\n".join([*lines, f"G1 Z{z} F300", "M400"]) + "\n")
    return path


def order(folder: Path, profile: str, moves: int, start=(100, 100, 50)) -> Order:
    folder.mkdir(exist_ok=True)
    job = write_job(folder / "part.gcode", moves, start)
    return Order(job, profile, "simulated", folder / "print", Retreat(lift_mm=5.0))


def back(station: Station) -> list[StationState]:
    """States until the station stands by again, or can't."""
    states = []
    for status in station.events():
        states.append(status.state)
        if status.state in (StationState.READY, StationState.HALTED, StationState.LOST):
            return states
    return states


def test_prints_and_stands_by_where_the_print_ended(at_rest, tmp_path, profile):
    at_rest.mount(syringe="bd_1ml", needle="25g", dish="petri_60mm", dish_centre_mm=(100, 100))
    at_rest.mount(floor_mm=45.0)
    job = order(tmp_path / "run", profile, 40)
    client = at_rest.print(job)
    assert client.wait(60).state is LinkState.DONE
    assert client.status.lines_executed == client.status.lines_done
    assert back(at_rest)[-1] is StationState.READY
    status = at_rest.status
    assert status.print_folder == str(job.folder)
    assert status.message.startswith("print done")
    assert status.position_mm == (102.5, 100, 50)
    assert status.plunger_mm == pytest.approx(0.4)
    assert status.position_trusted
    with pytest.raises(Refused, match="holds a print"):
        at_rest.jog("x", 1)
    at_rest.mount(dish="")
    assert at_rest.jog("x", -2.5).position_mm == (100, 100, 50)
    assert attach_print(job.folder).status.state is LinkState.DONE


def test_a_run_takes_over_what_was_printed_here(at_rest, tmp_path, profile):
    job = order(tmp_path / "run", profile, 10)
    at_rest.print(job).wait(60)
    back(at_rest)
    record = tmp_path / "run" / "executed.npz"
    with np.load(record) as data:
        assert set(range(5, 16)) <= set(data["line"].tolist())
    once = Order(**{**vars(job), "once": True})

    def never() -> str:
        raise AssertionError("it was printed again")

    assert find_or_start(once, never).status.state is LinkState.DONE
    note = record.with_suffix(".json")
    facts = json.loads(note.read_text())
    note.write_text(json.dumps({**facts, "code": "of another version"}))
    with pytest.raises(AssertionError, match="printed again"):
        find_or_start(once, never)


def test_half_a_print_is_no_whole_one(at_rest, tmp_path, profile):
    job = order(tmp_path / "run", profile, 20_000)
    client = at_rest.print(job)
    for status in client.events():
        if status.lines_done > 100:
            break
    client.stop()
    assert client.wait(60).state is LinkState.STOPPED
    assert back(at_rest)[-1] is StationState.READY
    status = at_rest.status
    assert status.position_mm is not None
    assert status.position_mm[2] == pytest.approx(54, abs=0.02), "lifted by 5 mm from Z 49"
    assert not is_complete_record(
        tmp_path / "run" / "executed.npz", job.sha256, load(Printer, profile)
    )


def test_job_for_another_place_printer_or_nonsense_is_refused(at_rest, tmp_path, profile):
    elsewhere = order(tmp_path / "run", profile, 3, start=(100, 100, 20))
    with pytest.raises(Refused, match=r"begins with the tip at X100.00 Y100.00 Z20.00.*30.00 mm"):
        at_rest.print(elsewhere)
    with pytest.raises(Refused, match="connected is"):
        at_rest.print(Order(elsewhere.job, "marlin_avr", "simulated", tmp_path, Retreat()))
    at_rest.mount(needle="25g")
    (tmp_path / "homes.gcode").write_text("G90\nG28 X\nG1 X5 F600\n")
    with pytest.raises(Refused, match="line 2, homes the machine with the needle 25g"):
        at_rest.print(Order(tmp_path / "homes.gcode", profile, "", tmp_path / "p", Retreat()))
    (tmp_path / "bad.gcode").write_text("M83\n")
    with pytest.raises(JobError, match="relative extrusion"):
        at_rest.print(Order(tmp_path / "bad.gcode", profile, "", tmp_path / "p", Retreat()))
    assert at_rest.status.state is StationState.READY
    assert at_rest.jog("z", 1).position_mm == (100, 100, 51)
