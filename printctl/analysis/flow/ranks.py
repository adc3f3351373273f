"""Solve a written 3D flow case on MPI ranks, by a Python that has FEniCSx."""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from design.errors import DesignError
from design.hemodynamics.three_d.ranks import RankResult, read_result
from printctl.errors import PrintctlError, UsageError
from printctl.processes.alive import KILL, send_signal

PYTHON_VARIABLE: Final = "PRINTCTL_DOLFINX_PYTHON"
INSTALL: Final = (
    "On Debian or Ubuntu: sudo apt-get install --no-install-recommends python3-dolfinx "
    "libopenblas0-pthread (150 MB). "
    "Anywhere else: conda create -n fenicsx -c conda-forge fenics-dolfinx mpich, then --python "
    f"PATH/TO/envs/fenicsx/bin/python, or the same in {PYTHON_VARIABLE}."
)
_ASK: Final = "import dolfinx, petsc4py.PETSc, mpi4py; print(dolfinx.__version__)"
_LIMIT_S: Final = 120.0


@dataclass(frozen=True)
class Engine:
    """What runs the ranks.

    Attributes
    ----------
    python : Path
        An interpreter that imports dolfinx.
    version : str
        Of dolfinx.
    """

    python: Path
    version: str


def find_engine(python: Path | None = None) -> Engine:
    """Find an interpreter with dolfinx: the one named, or the first of the usual places.

    The usual places: `PYTHON_VARIABLE`, this interpreter, the active conda environment,
    ``python3`` on the path, ``/usr/bin/python3``, environments of conda whose name has
    ``fenics`` or ``dolfinx``.

    Raises
    ------
    PrintctlError
        Where none has it; the message says how to install it.
    """
    named = python or (Path(os.environ[PYTHON_VARIABLE]) if PYTHON_VARIABLE in os.environ else None)
    if named is not None:
        version, reason = _ask(named)
        if version is None:
            raise PrintctlError(f"{named} doesn't import dolfinx ({reason}). {INSTALL}")
        return Engine(named, version)
    tried = []
    for candidate in _candidates():
        version, _ = _ask(candidate)
        if version is not None:
            return Engine(candidate, version)
        tried.append(str(candidate))
    raise PrintctlError(
        f"no Python with FEniCSx (dolfinx) found; tried {', '.join(tried)}. {INSTALL}"
    )


def find_mpirun(python: Path) -> Path:
    """The program that starts ranks: beside ``python`` (conda's own MPI), or on the path.

    Raises
    ------
    PrintctlError
        Where there is none.
    """
    for name in ("mpirun", "mpiexec"):
        beside = python.parent / name
        program = str(beside) if beside.exists() else shutil.which(name)
        if program:
            return Path(program)
    raise PrintctlError(f"neither mpirun nor mpiexec is beside {python} or on the path. {INSTALL}")


def rank_command(mpirun: Path, ranks: int) -> list[str]:
    """``mpirun`` for so many ranks; Open MPI wants to be told that root is meant.

    Open MPI counts cores, not threads, and refuses more ranks; the caller has counted already.
    """
    command = [str(mpirun), "-n", str(ranks)]
    if "Open MPI" not in _output([str(mpirun), "--version"])[0]:
        return command
    command.insert(1, "--oversubscribe")
    if hasattr(os, "getuid") and os.getuid() == 0:
        command.insert(1, "--allow-run-as-root")
    return command


def clean_environment() -> dict[str, str]:
    """Ours without what leads another Python to our packages; one thread a rank."""
    ours = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"}
    kept = {key: value for key, value in os.environ.items() if key not in ours}
    return kept | {"OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}


def _candidates() -> Iterator[Path]:
    seen = set()
    for path in _places():
        # Not resolved: an environment's interpreter is often a link to the system's.
        if path.exists() and path not in seen:
            seen.add(path)
            yield path


def _places() -> Iterator[Path]:
    yield Path(sys.executable)
    if "CONDA_PREFIX" in os.environ:
        yield Path(os.environ["CONDA_PREFIX"]) / "bin" / "python"
    on_path = shutil.which("python3")
    if on_path:
        yield Path(on_path)
    yield Path("/usr/bin/python3")
    for root in ("miniforge3", "mambaforge", "miniconda3", "anaconda3"):
        for home in (Path.home(), Path("/opt")):
            for pattern in ("*fenics*", "*dolfinx*"):
                yield from sorted((home / root / "envs").glob(f"{pattern}/bin/python"))


def _ask(python: Path) -> tuple[str | None, str]:
    """Version of dolfinx, or None and the last line of what went wrong."""
    if not python.exists():
        return None, "no such file"
    output, wrong = _output([str(python), "-c", _ASK])
    lines = wrong.strip().splitlines()
    return (output.strip().splitlines()[-1], "") if output.strip() else (None, (lines or ["?"])[-1])


def _output(command: list[str]) -> tuple[str, str]:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_LIMIT_S,
            stdin=subprocess.DEVNULL, env=clean_environment() | {"PYTHONSAFEPATH": "1"},
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as exc:
        return "", str(exc)
    return (done.stdout, done.stderr) if done.returncode == 0 else ("", done.stderr or done.stdout)


GRACE_S: Final = 10.0


def run_on_ranks(
    case_folder: Path,
    ranks: int,
    python: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> RankResult:
    """Solve a case that `write_case` wrote, on ``ranks`` processes of this machine.

    Parameters
    ----------
    case_folder : Path
    ranks : int
        From 1 to the machine's processors.
    python : Path, optional
        With dolfinx; else the first that `find_engine` finds.
    tell : callable, optional
        Is given each line of the log.

    Raises
    ------
    UsageError
        For fewer than one rank, more than processors, or a folder that holds no case.
    PrintctlError
        Without an engine, or when it fails; with the last lines it said.
    """
    _check(case_folder, ranks)
    engine = find_engine(python)
    command = [
        *rank_command(find_mpirun(engine.python), ranks),
        *(str(engine.python), "-m", "engine", "."),
    ]
    code, last = _followed(command, case_folder, tell or (lambda line: None))
    if code != 0:
        output = "\n".join(last) or "nothing was said"
        raise PrintctlError(f"the {ranks} ranks ended with code {code}:\n{output}")
    return read_result(case_folder)


def _check(case_folder: Path, ranks: int) -> None:
    if not (case_folder / "case.json").is_file():
        raise UsageError(f"{case_folder} holds no case.json; write the case first")
    most = os.cpu_count() or 1
    if not 1 <= ranks <= most:
        raise UsageError(
            f"{ranks} ranks on {most} processors; give 1 to {most}, or write a batch script for "
            "a cluster"
        )


def _followed(
    command: list[str], folder: Path, tell: Callable[[str], None]
) -> tuple[int, deque[str]]:
    """Run to the end, telling each line; whatever ends us ends it."""
    last: deque[str] = deque(maxlen=20)
    process = subprocess.Popen(
        command, cwd=folder, env=clean_environment(), text=True, errors="replace",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        with _ending_too(), process.stdout as lines:
            for line in lines:
                last.append(line.rstrip())
                tell(line.rstrip())
        return process.wait(), last
    finally:
        _end(process)


@contextmanager
def _ending_too() -> Iterator[None]:
    """Have a request to end come as an exception, as Ctrl-C does, so that the ranks end first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {each: signal.signal(each, _leave) for each in signals}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _leave(number: int, frame: object) -> None:
    raise SystemExit(128 + number)


def _end(process: subprocess.Popen[str]) -> None:
    """End mpirun, which ends its ranks when asked politely; its group when it doesn't."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        send_signal(process.pid, KILL, group=True)
        process.wait()


def main() -> int:
    """Run a case that is written already."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=Path, help="folder that write_case wrote")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--python", type=Path, help="an interpreter with dolfinx")
    asked = parser.parse_args()
    try:
        result = run_on_ranks(asked.case, asked.ranks, asked.python, _tell)
    except (PrintctlError, DesignError) as exc:
        print(exc, file=sys.stderr)
        return getattr(exc, "exit_code", 1)
    for k, (flow, pressure) in enumerate(zip(result.port_flow, result.port_pressure, strict=True)):
        print(f"port {k}: {flow:.6g} uL/s out, {pressure:.6g} Pa")
    return 0


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
