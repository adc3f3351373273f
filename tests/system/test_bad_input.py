"""Wrong input: one clear message, the right exit code, no half-written file."""

import os
import pty
import re
import resource
import select
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from printctl.machine.process.clients.client import attach
from tests.sim_process import printer_process
from tests.system.cli import ROOT, called, recipe_file

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"


def _refused(
    recipe: Path, folder: Path, code: int, *words: str, command: tuple[str, ...] = ("design",)
) -> str:
    """Run a command on ``recipe``, expect ``code`` and every one of ``words``, no traceback."""
    out = ("--out", "out" if command[0] != "toolpath" else "out.gcode")
    done = called(*command, recipe, *out, cwd=folder)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert not [path for path in folder.rglob("*") if ".part" in path.suffixes]
    return done.stderr


def _mesh_recipe(folder: Path, mesh: trimesh.Trimesh, unit: str = "mm") -> Path:
    mesh.export(folder / "tissue.stl")
    tissue = {"=": "replace", "mesh": "tissue.stl", "unit": unit}
    return recipe_file(folder, "cortex_embedded", tissue=tissue)


def test_empty_mesh(tmp_path: Path) -> None:
    (tmp_path / "tissue.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    tissue = {"=": "replace", "mesh": "tissue.stl", "unit": "mm"}
    _refused(recipe_file(tmp_path, "cortex_embedded", tissue=tissue), tmp_path, 1, "tissue.stl")


def test_mesh_in_inches_labelled_mm(tmp_path: Path) -> None:
    inches = trimesh.creation.box((3.0, 2.0, 1.0))
    _refused(_mesh_recipe(tmp_path, inches), tmp_path, 1, "3", "mm", "in")


def test_open_mesh(tmp_path: Path) -> None:
    box = trimesh.creation.box((30.0, 20.0, 10.0))
    box.update_faces(np.arange(len(box.faces)) != 3)
    _refused(_mesh_recipe(tmp_path, box), tmp_path, 1, "open")


def _network_recipe(folder: Path, *rows: str) -> Path:
    (folder / "network.csv").write_text(HEADER + "\n".join(rows) + "\n")
    given = {"=": "replace", "network": "network.csv", "unit": "mm"}
    return recipe_file(folder, "planar_fresh", vasculature=given)


def test_nan_in_a_network(tmp_path: Path) -> None:
    row = "0,0,1,0,4,1.5,16,nan,1.5,0.4,0.4,channel,0"
    _refused(_network_recipe(tmp_path, row), tmp_path, 1, "network.csv", "NaN")


def test_self_intersecting_network(tmp_path: Path) -> None:
    rows = ("0,0,1,0,4,1.5,16,4,1.5,0.4,0.4,channel,0", "1,2,3,8,0,1.6,8,8,1.6,0.4,0.4,channel,0")
    _refused(_network_recipe(tmp_path, *rows), tmp_path, 1, "vessel")


def test_vessel_thinner_than_the_needle_leaves_open(tmp_path: Path) -> None:
    recipe = _network_recipe(tmp_path, "0,0,1,0,4,1.5,16,4,1.5,0.04,0.04,channel,0")
    _refused(recipe, tmp_path, 1, "0.080 mm", "vessel 0", command=("toolpath",))


def test_vessel_thinner_than_the_needle_writes(tmp_path: Path) -> None:
    (tmp_path / "network.csv").write_text(HEADER + "0,0,1,2,4,1.5,14,4,1.5,0.05,0.05,artery,0\n")
    given = {"=": "replace", "network": "network.csv", "unit": "mm"}
    embedded = {"=": "replace", "method": "embedded", "needle": "30g"}
    mounted = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}
    recipe = recipe_file(
        tmp_path, "planar_fresh", vasculature=given, toolpath=embedded, printer=mounted
    )
    _refused(recipe, tmp_path, 1, "0.100 mm", "needle", command=("toolpath",))


def _coarse(**sections: Any) -> dict[str, Any]:
    """Large parts are sliced coarsely, so that their tests are quick."""
    return {"toolpath": {"layer_um": 500, "line_um": 1000}, **sections}


def test_part_larger_than_the_printer(tmp_path: Path) -> None:
    _network = "0,0,1,0,4,2.5,240,4,2.5,1.5,1.5,channel,0"
    recipe = _network_recipe(tmp_path, _network)
    data = _coarse(tissue={"size_mm": [240, 8, 5]}, vasculature={"=": "replace",
                   "network": "network.csv", "unit": "mm"})  # fmt: skip
    recipe = recipe_file(tmp_path, "planar_fresh", **data)
    words = ("greatest x of the part: 220 mm, limit 200", "place_mm", "a larger printer")
    _refused(recipe, tmp_path, 3, *words, command=("toolpath",))


def test_more_ink_than_the_syringe_holds(tmp_path: Path) -> None:
    recipe = _network_recipe(tmp_path, "0,0,1,0,4,2.5,40,4,2.5,1.5,1.5,channel,0")
    data = _coarse(tissue={"size_mm": [40, 8, 5]}, vasculature={"=": "replace",
                   "network": "network.csv", "unit": "mm"})  # fmt: skip
    recipe = recipe_file(tmp_path, "planar_fresh", **data)
    _refused(recipe, tmp_path, 3, "µL", "1000", "syringe", command=("toolpath",))


MOUNTED = (
    *("--needle", "30g_50mm", "--bath", "gelatin_support", "--dish", "box_80mm"),
    *("--syringe", "hamilton_1ml", "--ink", "collagen_fresh", "--for-mounted"),
)


def test_missing_port(tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text("G90\nM82\nG92 X100 Y100 Z5 E0\nG1 X105 F600\nM400\n")
    done = called(
        "print", "job.gcode", "--printer", "generic_marlin", "--port", "/dev/ttyNONE9", "--yes",
        *MOUNTED, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "/dev/ttyNONE9" in done.stderr
    assert "Traceback" not in done.stderr


def test_print_on_a_real_port_asks_first(tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text("G90\nM82\nG92 X100 Y100 Z5 E0\nG1 X105 F600\nM400\n")
    done = called(
        "print", "job.gcode", "--printer", "generic_marlin", "--port", "/dev/ttyNONE9",
        *MOUNTED, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "--yes" in done.stderr


def test_full_disk_leaves_the_good_file(tmp_path: Path) -> None:
    """A write that fails half-way (here by a file size limit) leaves what was there."""
    coarse = {"=": "replace", "method": "fresh", "needle": "22g", "layer_um": 150, "line_um": 400}
    recipe = recipe_file(tmp_path, "planar_fresh", toolpath=coarse)
    (tmp_path / "part.gcode").write_text("a good file")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        done = called("toolpath", recipe, "--out", "part.gcode", cwd=tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "too large" in done.stderr
    assert (tmp_path / "part.gcode").read_text() == "a good file"
    assert {path.name for path in tmp_path.iterdir()} == {"recipe.yaml", "part.gcode"}


def test_missing_mesh(tmp_path: Path) -> None:
    tissue = {"=": "replace", "mesh": "none.stl", "unit": "mm"}
    _refused(recipe_file(tmp_path, "cortex_embedded", tissue=tissue), tmp_path, 2, "none.stl")


@pytest.mark.parametrize("command", ["design", "run"])
def test_missing_recipe(tmp_path: Path, command: str) -> None:
    _refused(tmp_path / "none.yaml", tmp_path, 2, "printctl init", command=(command,))


# --- ctrl-C during a print on a real terminal: asks to detach, stop or kill
@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    with printer_process(tmp_path, speed=3) as name:
        yield name


@pytest.fixture
def job(tmp_path: Path) -> Path:
    lines = ["G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z5 E0"]
    lines += [f"G1 X{100 + 5 * (k % 2)} E{0.005 * k:.4f} F3000" for k in range(1, 5001)]
    path = tmp_path / "job.gcode"
    path.write_text("\n".join([*lines, "G0 Z30 F300", "M400"]) + "\n")
    return path


class Terminal:
    """``printctl print`` as a person sees it, on a terminal of a kind (``TERM``)."""

    def __init__(self, job: Path, port: str, kind: str = "xterm") -> None:
        self.pid, self.handle = pty.fork()
        if self.pid == 0:
            os.chdir(ROOT)
            command = [sys.executable, "-m", "printctl", "print", str(job), "--yes", *MOUNTED]
            command += ["--printer", "generic_marlin", "--port", port]
            os.execve(sys.executable, command, os.environ | {"TERM": kind})
        self.seen = ""

    def expect(self, pattern: str, within_s: float = 60) -> None:
        """Read until ``pattern`` is on the screen; then forget what came before it."""
        limit = time.monotonic() + within_s
        while not (found := re.search(pattern, self.seen)):
            assert time.monotonic() < limit, f"{pattern!r} not in {self.seen[-2000:]!r}"
            if select.select([self.handle], [], [], 0.5)[0]:
                try:
                    self.seen += os.read(self.handle, 65536).decode(errors="replace")
                except OSError:
                    raise AssertionError(
                        f"ended without {pattern!r}: {self.seen[-2000:]!r}"
                    ) from None
        self.seen = self.seen[found.end() :]

    def type(self, keys: str) -> None:
        os.write(self.handle, keys.encode())

    def exit_code(self) -> int:
        while True:
            try:
                if not os.read(self.handle, 65536):
                    break
            except OSError:
                break
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def test_detach_leaves_it_printing_and_stop_ends_it_in_order(job: Path, port: str) -> None:
    first = Terminal(job, port)
    first.expect(r"[1-9]\d* of 5007 lines")
    first.type("\x03")
    first.expect("detach")
    first.type("d\n")
    first.expect("detached; the print goes on")
    assert first.exit_code() == 1

    again = Terminal(job, port)
    again.expect(r"[1-9]\d* of 5007 lines")
    again.type("\x03")
    again.expect("cancel")
    again.type("c\n")
    again.expect("ended as cancelled")
    assert again.exit_code() == 4
    left = attach(job.with_name("job.gcode.print")).status
    assert left.position_known
    assert 0 < left.lines_done < 5007


def test_kill_halts_the_printer(job: Path, port: str) -> None:
    terminal = Terminal(job, port, "dumb")
    terminal.expect(r"print +\d+% [1-9]\d* of 5007 lines\r\n")
    terminal.type("\x03")
    terminal.expect("EMERGENCY STOP")
    terminal.type("e\n")
    terminal.expect("ended as halted")
    assert terminal.exit_code() == 4
    assert not attach(job.with_name("job.gcode.print")).status.position_known
