"""`printctl station` from the command line: connect, query, move."""

from __future__ import annotations

import json

import pytest

from tests.printctl.cli.shell import Shell


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
