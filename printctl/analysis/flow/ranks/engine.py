"""Find a Python with FEniCSx, and the program that starts MPI ranks."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from printctl.errors import PrintctlError

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
            stdin=subprocess.DEVNULL, env=clean_environment(),
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as exc:
        return "", str(exc)
    return (done.stdout, done.stderr) if done.returncode == 0 else ("", done.stderr or done.stdout)
