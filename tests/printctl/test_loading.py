"""Import time: printing and serving load no unneeded libraries."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest

from benchmarks.checkers import box_triangles, write_stl
from design.on_demand import exported_names
from printctl.pipeline.run_options import WHOLE_NAMES
from printctl.pipeline.running.sequences import WHOLE
from printctl.processes.second import SecondProcess

HEAVY = (
    "cv2",
    "manifold3d",
    "matplotlib",
    "meshio",
    "networkx",
    "nibabel",
    "numba",
    "scipy",
    "shapely",
    "skimage",
    "gcode.program.gcode",
    "trimesh",
)
ON_DEMAND = (
    "design.hemodynamics",
    "design.lattices",
    "design.measures",
    "design.solids",
    "design.tissue",
    "design.toolpath.embedded",
    "design.toolpath.fresh",
    "design.toolpath.gcode",
    "design.vasculature",
    "printctl.checks.bead",
    "printctl.calibration",
    "printctl.checks.gcode_view",
    "printctl.checks.preflight",
    "printctl.web.live",
    "printctl.pipeline.network_sources",
    "printctl.recipe",
    "registration.measuring.gauging",
    "report.picture",
    "registration.files.readers",
    "report",
    "report.gcode",
    "report.views",
)


@pytest.fixture(scope="module")
def loaded_so_far() -> list[set[str]]:
    """Modules that one new process has after importing each of `STEPS` in turn."""
    return _loaded(STEPS)


@pytest.fixture(scope="module")
def loaded_for_work() -> list[set[str]]:
    """The same for each of `WORK`."""
    return _loaded(WORK)


def _loaded(steps: tuple[tuple[str, ...], ...]) -> list[set[str]]:
    lines = ["import sys"]
    for step in steps:
        lines += [*(f"import {module}" for module in step), "print(*sys.modules)"]
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [set(line.split()) for line in done.stdout.splitlines()]


BEGUN = (
    "printctl.machine.process.__main__",
    "printctl.machine.process.clients.starting",
    "printctl.web.serving.stop_process",
    "printctl.pipeline.network_sources",
    "printctl.recipe",
    "printctl.cli.judge.register",
    "printctl.web.app",
)
"""Stations, links, their clients, the stop process, recipes, a command's help, the server."""
STEPS = (
    (
        "printctl.machine.process.clients.client",
        "printctl.checks.gate",
        "printctl.cli.machine.running_print",
    ),
    BEGUN,
    ("printctl.cli.design.run",),
)
"""What all of them together don't load, none of them does."""
WORK = (
    ("design.solids",),
    ("design.solids; design.solids.lumen_solid",),
    ("printctl.pipeline.judging.register_inputs",),
    ("design.hemodynamics.three_d",),
)


def test_a_link_and_the_status_of_a_print_need_no_numpy(loaded_so_far):
    assert "printctl.cli.machine.running_print" in loaded_so_far[0]
    assert "numpy" not in loaded_so_far[0]


def test_processes_begin_without_kernels_meshes_and_figures(loaded_so_far):
    assert not loaded_so_far[1] & set(HEAVY)


def test_a_recipe_is_refused_before_what_does_its_work_is_loaded(loaded_so_far):
    assert not loaded_so_far[2] & {"numba", "manifold3d", "shapely", "skimage"}


def test_registering_loads_no_plotting_library(loaded_for_work):
    assert not loaded_for_work[2] & {"matplotlib", "jinja2", "scipy.stats"}


def test_the_engine_of_3d_flow_is_loaded_only_when_it_is_needed(loaded_for_work):
    assert "ngsolve" not in loaded_for_work[3]


LOADED_BY_NONE = ("matplotlib", "networkx", "skimage", "trimesh")
WITHOUT = {
    ("slice", "MODEL", "--unit", "mm", "--out", "OUT"): (
        *("design.hemodynamics", "lxml", "numba.np.linalg", "printctl.machine.process"),
        *("printctl.recipe.model", "pycparser", "registration", "report", "scipy.linalg"),
        *("scipy.sparse", "scipy.spatial"),
    ),
    ("--help",): ("firmware_profiles", "numba", "numpy", "pydantic_core", "scipy"),
    ("status", "--help"): ("numba", "numpy", "scipy"),
    ("doctor", "--help"): ("numba", "numpy", "scipy"),
}
"""By command what it isn't to load: start-up took half of a short command's time."""
WORDS = """
import sys
from printctl.cli.main import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print(*sys.modules)
"""


@pytest.mark.parametrize("words", WITHOUT, ids=" ".join)
def test_a_command_loads_only_what_it_uses(words, tmp_path):
    write_stl(tmp_path / "cube.stl", box_triangles(np.zeros(3), np.array([2.0, 2.0, 0.3])))
    paths = {"MODEL": str(tmp_path / "cube.stl"), "OUT": str(tmp_path / "cube.gcode")}
    given = [paths.get(word, word) for word in words]
    for _ in range(2):  # kernels may have to be compiled first
        done = subprocess.run(
            [sys.executable, "-c", WORDS, *given], capture_output=True, text=True, check=True
        )
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "printctl.cli.main" in loaded
    assert not loaded & {*WITHOUT[words], *LOADED_BY_NONE}


def test_a_name_on_demand_brings_what_it_needs(loaded_for_work):
    assert "manifold3d" not in loaded_for_work[0]
    assert "manifold3d" in loaded_for_work[1]


@pytest.mark.parametrize("package", ON_DEMAND)
def test_each_name_that_is_handed_on_can_be_had_and_is_no_modules(package):
    room = import_module(package)
    homes = exported_names(package)
    assert set(homes) == set(room.__all__)
    assert not set(homes) & {
        found.name for found in iter_modules([str(Path(room.__file__).parent)])
    }
    for name, home in homes.items():
        assert getattr(room, name) is getattr(import_module(home), name)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = room.nothing


def test_each_name_that_is_asked_of_a_package_is_handed_on():
    """`preflight.shaft_lines` was asked for, and not handed on: a traceback behind a dry run."""
    root, wrong = Path(__file__).parents[2], []
    for file in [
        path
        for room in ("printctl", "design", "gcode", "sim")
        for path in (root / room).rglob("*.py")
    ]:
        text = file.read_text(encoding="utf-8")
        for package in ON_DEMAND:
            above, _, name = package.rpartition(".")
            if re.search(
                rf"^from {re.escape(above)} import .*\b{name}\b(?! as)", text, re.MULTILINE
            ):
                asked = set(re.findall(rf"(?<![\w.]){name}\.(\w+)", text))
                wrong += [f"{file}: {name}.{one}" for one in asked if not _has(package, one)]
    assert wrong == []


def _has(package: str, name: str) -> bool:
    return hasattr(import_module(package), name) or find_spec(f"{package}.{name}") is not None


def test_names_of_stages_are_those_of_the_stages():
    assert tuple(stage.name for stage in WHOLE) == WHOLE_NAMES


# --- function calls in a second process
def where() -> int:
    """The process that works."""
    return os.getpid()


def test_a_call_is_made_in_another_process_and_raises_what_it_raises():
    with SecondProcess() as second:
        there, missing = second.call(__name__, "where"), second.call("json", "loads", "{")
        again = second.call(__name__, "where")
        assert there.result() == again.result() != os.getpid()
        with pytest.raises(ValueError, match="Expecting property name"):
            missing.result()


@pytest.mark.skipif(os.name == "nt", reason="no signals")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_the_first_and_lets_go_of_the_output(how: signal.Signals) -> None:
    code = (
        "import os\n"
        "from printctl.processes.second import SecondProcess\n"
        "with SecondProcess() as second:\n"
        "    print(second.call('os', 'getpid').result(), flush=True)\n"
        "    second.call('time', 'sleep', 600).result()\n"
    )
    first = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert first.stdout is not None
    assert int(first.stdout.readline()) != first.pid
    first.send_signal(how)
    first.communicate(timeout=60)  # until no process holds the pipe
    assert first.returncode == -how
