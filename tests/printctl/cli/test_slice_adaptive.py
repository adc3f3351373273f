"""`printctl slice --thinnest-layer-um`: adaptive layer heights in the file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold

from design.solids import write_stl
from firmware_profiles import Printer, load
from printctl.checks.lumens import Writing, read_layers
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.cli.shell import Shell

BORE_MM = 4.61
UL_PER_MM = np.pi / 4 * BORE_MM**2
PRINTER = load(Printer, "generic_marlin")


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)


@pytest.fixture
def sliced(tmp_path: Path, shell: Shell) -> bytes:
    """A foot with upright walls, a part of 50° above it, and a gap of 0.3 mm below its cap."""
    away = np.tan(np.radians(50.0))
    corners = [(x, y, 0.36) for x in (0, 3) for y in (0, 2)]
    corners += [(x, y, 0.96) for x in (0, 3 + 0.6 * away) for y in (0, 2)]
    body = block(3, 2, 0.36) + as_hull(corners) + block(3, 2, 0.3).translate([0, 0, 1.26])
    write_stl(tmp_path / "part.stl", as_solid(body))
    words = ("--unit", "mm", "--out", "part.gcode", "--thinnest-layer-um", "20")
    code, out, _ = shell("slice", "part.stl", *words)
    assert code == 0
    assert "layers of 25 to 60 µm" in out
    return (tmp_path / "part.gcode").read_bytes()


def as_hull(corners: list[tuple[float, float, float]]) -> Manifold:
    return Manifold.hull_points(np.array(corners, dtype=float))


def test_each_layer_says_its_height_before_it_is_written(sliced: bytes) -> None:
    """By a reader of this test's own: from tip's height to tip's height where ink lies below."""
    said, z, e, top, found = np.nan, 0.0, 0.0, 0.0, []
    for line in sliced.decode().splitlines():
        words = {axis: float(value) for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", line)}
        if line.startswith(";HEIGHT:"):
            said = float(line[8:])
        elif line.startswith("G1") and "X" in words and words.get("E", e) > e and z > top:
            found.append((z, said))
            top = z
        z = words.get("Z", z)
        e = words.get("E", e)
    tops, heights = np.array(found).T
    assert tops[0] == heights[0] == pytest.approx(0.06)
    gaps = np.diff(tops)
    below_cap = int(np.argmax(gaps))
    assert gaps[below_cap] > 0.3
    assert np.delete(gaps, below_cap) == pytest.approx(np.delete(heights[1:], below_cap))
    assert heights[below_cap + 1] == pytest.approx(0.06)


def test_whole_files_volume_is_the_part_s(sliced: bytes) -> None:
    lines, _ = read_layers(sliced, Writing(PRINTER, UL_PER_MM))
    thick = (lines.high - lines.low)[lines.layer]
    ink = (lines.mean * thick * np.linalg.norm(lines.end - lines.start, axis=1)).sum()
    part = 6 * 0.36 + 2 * 0.6 * (3 + 0.3 * np.tan(np.radians(50.0))) + 6 * 0.3
    assert ink == pytest.approx(part, rel=0.01)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--thinnest-layer-um", "60"), "must be at least a step lower"),
        (("--thinnest-layer-um", "2"), "--thinnest-layer-um"),
    ],
)
def test_heights_that_can_t_be_are_refused(
    tmp_path: Path,
    shell: Shell,
    words: tuple[str, str],
    said: str,
) -> None:
    write_stl(tmp_path / "part.stl", as_solid(block(3, 2, 0.36)))
    code, _, err = shell("slice", "part.stl", "--unit", "mm", "--out", "a.gcode", *words)
    assert code in (1, 2)
    assert said in " ".join(err.split())
    assert not (tmp_path / "a.gcode").exists()
