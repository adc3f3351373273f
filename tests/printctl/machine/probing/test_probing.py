"""Printer settings compared with a profile, queried over the link's channel."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from firmware_profiles import Axes, Printer, Span, load
from firmware_profiles.families import find_family
from printctl.machine.errors import PortInUse
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.transport import open_port
from printctl.machine.probing import (
    Settings,
    compare,
    corrected_profile,
    query_settings,
    query_transport,
    read_settings,
)
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import wired
from tests.sim_process import printer_process
from tests.system.cli import called

MARLIN = load(Printer, "generic_marlin")
REAL = {
    "steps_per_mm": Axes(x=81, y=80, z=400, e=6000),
    "max_speed_mm_s": Axes(x=250, y=300, z=5, e=2),
    "acceleration_mm_s2": 900.0,
    "z_mm": Span(low=0, high=180),
}
DIFFERS = {"steps_per_mm.x", "steps_per_mm.e", "max_speed_mm_s.x", "z_mm.high"}


def asked(firmware: str, folder: Path) -> tuple[Settings, Printer]:
    """Ask a simulated printer whose settings aren't the profile's."""
    profile = MARLIN.model_copy(update={"firmware": firmware, "resets_on_connect": False})
    real = profile.model_copy(update=REAL)
    transport = SimTransport(
        simulated_printer(real)(real, (50.0, 50.0, 10.0)), VirtualClock(), np.random.default_rng(1)
    )
    wiring = wired(transport, folder, b"G21\n", profile, protocol=made_protocol(firmware)).wiring
    return query_transport(wiring), profile


@pytest.mark.parametrize(
    ("firmware", "differs"),
    [
        ("marlin", DIFFERS | {"acceleration_mm_s2"}),
        ("reprapfirmware", DIFFERS),
        ("klipper", {"acceleration_mm_s2"}),
    ],
)
def test_just_what_differs_is_found(firmware: str, differs: set[str], tmp_path: Path) -> None:
    settings, profile = asked(firmware, tmp_path)
    rows = compare(settings, profile)
    assert find_family(firmware).reported_name in settings.firmware.lower()
    assert {row.key for row in rows if not row.same} == differs
    found = {row.key: row.printer for row in rows}
    if firmware != "klipper":
        assert found["steps_per_mm.e"] == 6000
        assert found["max_speed_mm_s.x"] == 250
        assert found["z_mm.high"] == 180


def test_asking_changes_nothing_and_moves_nothing(tmp_path: Path) -> None:
    for firmware in ("marlin", "reprapfirmware", "klipper"):
        folder = tmp_path / firmware
        folder.mkdir()
        first, _ = asked(firmware, folder)
        assert first == asked(firmware, folder)[0]


def test_endstops_that_are_off_are_told() -> None:
    replies = (b"  M211 S0 ; OFF", b"  Min:  X0.00 Y0.00 Z0.00   Max:  X200.00 Y200.00 Z200.00")
    settings = read_settings(find_family("marlin"), {b"M211": replies})
    assert "endstops are off" in settings.notes[0]
    assert settings.values["x_mm.high"] == 200


def test_corrected_profile_has_the_printer_s_values_and_fewer_starting_ones(tmp_path: Path) -> None:
    profile = load(Printer, "makergear_m2_duet2")
    settings = Settings(
        "RepRapFirmware",
        {"steps_per_mm.e": 5900.0, "x_mm.low": 0.0, "x_mm.high": 203.0, "max_speed_mm_s.x": 30.0},
    )
    rows = compare(settings, profile)
    data = corrected_profile(profile, rows, "/dev/ttyACM0", "2026-11-20")
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(data))
    mine = load(Printer, str(path))
    assert mine.steps_per_mm == Axes(x=88.89, y=88.89, z=400, e=5900)
    assert mine.x_mm == Span(low=0, high=203)
    assert "x_mm" not in mine.starting_values
    assert "steps_per_mm.e" not in mine.starting_values
    # Told in part: the rest still is to be measured.
    assert {"max_speed_mm_s.y", "max_speed_mm_s.z", "max_speed_mm_s.e"} <= set(mine.starting_values)
    assert "steps_per_mm.e, x_mm.high" in mine.source
    assert compare(settings, mine) == [
        row for row in compare(settings, mine) if row.same and not row.starting
    ]


# --- over a real pipe ---------------------------------------------------------------------------


def test_command_shows_differences_writes_the_profile_and_leaves_a_used_port_alone(
    tmp_path: Path,
) -> None:
    values = MARLIN.model_dump(mode="json", exclude_unset=True)
    values["steps_per_mm"]["e"] = 6300
    (tmp_path / "old.yaml").write_text(yaml.safe_dump(values))
    with printer_process(tmp_path) as port:
        owner = open_port(port, MARLIN)
        try:
            with pytest.raises(PortInUse, match="held by another program"):
                query_settings(port, MARLIN)
        finally:
            owner.close()
        done = called(
            "profiles", "probe", "--port", port, "--profile", "old.yaml", "--write", "new.yaml",
            "--json", cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 1, done.stderr
        told = json.loads(done.stdout)
        assert [row["key"] for row in told["rows"] if not row["same"]] == ["steps_per_mm.e"]
        again = called("profiles", "probe", "--port", port, "--profile", "new.yaml", cwd=tmp_path)
        assert again.returncode == 0, again.stdout + again.stderr
        assert "DIFFERS" not in again.stdout
    assert called("profiles", "check", "new.yaml", cwd=tmp_path).returncode == 0


def test_a_new_profile_is_filled_in_by_the_printer_and_no_other_file_is_replaced(
    tmp_path: Path,
) -> None:
    (tmp_path / "answers.yaml").write_text("name: Rig\nplunger_steps: 6400\n")
    made = called("profiles", "new", "mine.yaml", "--answers", "answers.yaml", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    (tmp_path / "other.yaml").write_text("kept")
    with printer_process(tmp_path) as port:
        probe = ("profiles", "probe", "--port", port, "--profile", "mine.yaml", "--write")
        assert called(*probe, "other.yaml", cwd=tmp_path).returncode == 2
        assert called(*probe, "mine.yaml", cwd=tmp_path).returncode == 1
        assert called(*probe, "mine.yaml", cwd=tmp_path).returncode == 0
    assert (tmp_path / "other.yaml").read_text() == "kept"
    mine = load(Printer, str(tmp_path / "mine.yaml"))
    assert mine.max_speed_mm_s == MARLIN.max_speed_mm_s
    assert not {"steps_per_mm", "max_speed_mm_s", "x_mm"} & set(mine.starting_values)
    assert "plunger_travel_mm" in mine.starting_values
