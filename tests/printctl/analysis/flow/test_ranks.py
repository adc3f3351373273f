"""MPI ranks: start and end; the solver itself where FEniCSx is installed."""

import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.flow_pipes import pipe_mesh
from design.hemodynamics.three_d.ranks import (
    PortFlow,
    PortPressure,
    PortShare,
    RankConditions,
    RankResult,
    write_case,
)
from printctl.analysis.flow.ranks import Engine, find_engine, main, rank_command, run_on_ranks
from printctl.errors import PrintctlError, UsageError

RADIUS, LENGTH, FLOW, VISCOSITY = 0.2, 0.6, 4.0, 1e-3
MESH = pipe_mesh(RADIUS, LENGTH, 2, 5)


@pytest.fixture
def case(tmp_path) -> Path:
    write_case(MESH, RankConditions((PortFlow(FLOW), PortPressure()), VISCOSITY), tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def engine() -> Engine:
    """FEniCSx, where it is; .ci/run installs it."""
    try:
        found = find_engine()
    except PrintctlError as exc:
        pytest.skip(f"no FEniCSx: {exc}")
    if not (shutil.which("mpirun") or shutil.which("mpiexec")):
        pytest.skip("no mpirun")
    return found


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(0o755)
    return path


@pytest.fixture
def stand_in(tmp_path) -> Path:
    """A Python that claims dolfinx, and beside it an mpirun that runs `job.py` instead."""
    home = tmp_path / "conda" / "bin"
    script(home / "mpirun", "import sys, runpy\n"
           "print('other MPI') if '--version' in sys.argv else "
           f"runpy.run_path({str(tmp_path / 'job.py')!r})\n")  # fmt: skip
    return script(home / "python", "print('9.9.9')\n")


def test_the_first_python_with_dolfinx_is_taken(stand_in, monkeypatch):
    assert find_engine(stand_in) == Engine(stand_in, "9.9.9")
    monkeypatch.setenv("PRINTCTL_DOLFINX_PYTHON", str(stand_in))
    assert find_engine().python == stand_in


def test_without_fenicsx_the_message_says_how_to_install_it(tmp_path, monkeypatch):
    bare = script(tmp_path / "python", "raise ModuleNotFoundError('dolfinx')\n")
    with pytest.raises(PrintctlError, match=r"doesn't import dolfinx \(ModuleNot.*apt-get install"):
        find_engine(bare)
    with pytest.raises(PrintctlError, match="no such file"):
        find_engine(tmp_path / "nothing")
    monkeypatch.setattr("printctl.analysis.flow.ranks._places", lambda: iter([bare]))
    monkeypatch.delenv("PRINTCTL_DOLFINX_PYTHON", raising=False)
    with pytest.raises(PrintctlError, match=r"no Python with FEniCSx.*conda create"):
        find_engine()


def test_open_mpi_is_told_that_root_is_meant_only_where_it_is_root(tmp_path, monkeypatch):
    open_mpi = script(tmp_path / "mpirun", "print('mpirun (Open MPI) 4.1.4')\n")
    monkeypatch.setattr(os, "getuid", lambda: 0)
    assert "--allow-run-as-root" in rank_command(open_mpi, 2)
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    assert "--allow-run-as-root" not in rank_command(open_mpi, 2)
    other = script(tmp_path / "mpiexec", "print('HYDRA build details')\n")
    assert rank_command(other, 2) == [str(other), "-n", "2"]


@pytest.mark.parametrize("ranks", [0, 1 + (os.cpu_count() or 1)])
def test_more_ranks_than_processors_are_refused(case, ranks):
    with pytest.raises(UsageError, match=f"{ranks} ranks on .* processors; give 1 to"):
        run_on_ranks(case, ranks)


def test_a_folder_without_a_case_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"holds no case\.json"):
        run_on_ranks(tmp_path, 1)


def test_a_failing_engine_tells_its_last_lines(case, stand_in, tmp_path):
    (tmp_path / "job.py").write_text("print('step 1'); raise SystemExit('out of memory')")
    told = []
    with pytest.raises(PrintctlError, match=r"ended with code 1:\nstep 1\nout of memory"):
        run_on_ranks(case, 1, stand_in, told.append)
    assert told == ["step 1", "out of memory"]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "end"])
def test_what_ends_us_ends_the_ranks(case, stand_in, tmp_path, how):
    (tmp_path / "job.py").write_text("import os, time\nprint(os.getpid(), flush=True)\n"
                                     "time.sleep(30)")  # fmt: skip
    # What runs in the background of a shell is begun deaf to Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    begun = []

    def struck(line: str) -> None:
        begun.append(int(line))
        signal.raise_signal(how)

    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)):
            run_on_ranks(case, 1, stand_in, struck)
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(begun[0], 0)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_the_door_ends_in_one_message(case, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["ranks", str(case), "--ranks", "0"])
    assert main() == 2
    assert "0 ranks on" in capsys.readouterr().err


def solved(folder: Path, engine: Engine, ranks: int, *ports, mesh=MESH, **options) -> RankResult:
    write_case(mesh, RankConditions(ports, VISCOSITY, **options), folder)
    return run_on_ranks(folder, ranks, engine.python)


def test_poiseuilles_pressure_drop_comes_out(engine, tmp_path):
    told = []
    write_case(MESH, RankConditions((PortFlow(FLOW), PortPressure(5.0)), VISCOSITY), tmp_path)
    found = run_on_ranks(tmp_path, 1, engine.python, told.append)
    drop = 8.0 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    assert found.port_pressure[0] - found.port_pressure[1] == pytest.approx(drop, rel=5e-3)
    assert found.port_pressure[1] == pytest.approx(5.0, abs=1e-2 * drop)
    assert found.port_flow == pytest.approx([-FLOW, FLOW], rel=1e-9)
    # Nodes keep the mesh's own numbers: the parabola along, linear pressure.
    r = np.hypot(*MESH.points[:, :2].T)
    exact = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (r / RADIUS) ** 2)
    assert np.abs(found.velocity[:, 2] - exact).max() < 0.02 * exact.max()
    corners = MESH.points[: MESH.corner_count]
    line = 5.0 + drop * (1.0 - corners[:, 2] / LENGTH)
    assert np.abs(found.pressure - line).max() < 0.02 * drop
    assert any("unknowns" in line for line in told)
    assert found.report["solver"] == "direct"
    assert len(found.report["memory_mb"]) == 1


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_two_ranks_find_what_one_does_by_either_solver(engine, tmp_path):
    mesh = pipe_mesh(RADIUS, LENGTH, 2, 3, bend_rad=1.0)
    ports = PortFlow(FLOW), PortPressure(1.0, 2.0)
    one = solved(tmp_path / "one", engine, 1, *ports, mesh=mesh)
    for solver in ("direct", "iterative"):
        two = solved(tmp_path / solver, engine, 2, *ports, mesh=mesh, solver=solver)
        assert two.report["ranks"] == 2
        assert len(two.report["memory_mb"]) == 2
        assert np.abs(two.pressure - one.pressure).max() < 1e-6 * np.abs(one.pressure).max()
        assert np.abs(two.velocity - one.velocity).max() < 1e-6 * np.abs(one.velocity).max()
    # p = 1 + 2 Q at the mean of the port, to the discretisation.
    assert one.port_pressure[1] == pytest.approx(1.0 + 2.0 * FLOW, rel=1e-2)
    # At Re = 12 a bend costs more than a straight pipe.
    straight = 8.0 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    assert one.port_pressure[0] - one.port_pressure[1] > straight


@pytest.mark.slow
def test_a_supplys_flow_and_given_pressures_come_out(engine, tmp_path):
    ports = PortShare(0), PortPressure(3.0)
    found = solved(tmp_path, engine, 1, *ports, supplies=(FLOW,), model="stokes")
    assert found.port_flow == pytest.approx([-FLOW, FLOW], rel=1e-9)
    driven = PortPressure(found.port_pressure[0]), PortPressure(found.port_pressure[1])
    again = solved(tmp_path, engine, 1, *driven, model="stokes")
    assert again.port_flow == pytest.approx(found.port_flow, rel=1e-3)


def test_what_fails_on_the_ranks_is_told(engine, case):
    (case / "faces.npy").unlink()
    with pytest.raises(PrintctlError, match=r"rank \d: FileNotFoundError.*faces\.npy"):
        run_on_ranks(case, min(2, os.cpu_count() or 1), engine.python)
