"""Install and run svv in its own environment, outside the repository.

It is given its compiled extras, and one thread for linear algebra: with more it is five times
slower, its optimiser's matrices being 2 x 2.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

VERSION = "0.0.57"
SCRIPT = Path(__file__).with_name("vasculature_svv.py")
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1") | {
    "SVV_TELEMETRY_DISABLED": "1"
}
_FOLDER = Path.home() / ".cache" / "printctl-bench" / f"svv-{VERSION}"


class NoPeerError(Exception):
    """svv can't be installed or run here, and why."""


def svv_python() -> Path:
    """The interpreter that has svv; installs it at the first call.

    Raises
    ------
    NoPeerError
        When it can't be installed.
    """
    python = _FOLDER / "bin" / "python"
    if not _has_svv(python):
        _run([sys.executable, "-m", "venv", str(_FOLDER)], 120)
        wanted = [f"svv=={VERSION}", f"svv-accelerated=={VERSION}"]
        _run([str(python), "-m", "pip", "install", "--quiet", *wanted], 1800)
        if not _has_svv(python):
            raise NoPeerError(f"svv {VERSION} was installed but can't be imported")
    return python


def _has_svv(python: Path) -> bool:
    if not python.exists():
        return False
    check = "import svv_accel; from svv.tree.tree import Tree; import svv; print(svv.__version__)"
    done = subprocess.run([python, "-c", check], capture_output=True, text=True, check=False)
    return done.stdout.strip().endswith(VERSION)


def grow_svv(terminals: int, side_mm: float, flow_ul_s: float, out: Path) -> dict[str, Any]:
    """Grow svv's tree in a cube; ``out`` gets its radii, ``out`` + `.ratios` those of its ratios.

    Raises
    ------
    NoPeerError
        When svv can't be installed or fails.
    """
    given = {
        "--terminals": terminals,
        "--side-mm": side_mm,
        "--flow-ul-s": flow_ul_s,
        "--viscosity-pa-s": 4e-3,
        "--seed": 1,
        "--out": out,
        "--out-ratios": ratios_path(out),
    }
    words = [str(word) for pair in given.items() for word in pair]
    text = _run([str(svv_python()), str(SCRIPT), *words], 3600)
    found: dict[str, Any] = json.loads(text.strip().splitlines()[-1])
    return found


def ratios_path(out: Path) -> Path:
    """Where the tree with radii from svv's ratios is written."""
    return out.with_suffix(".ratios.csv")


def _run(command: list[str], seconds: float) -> str:
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=seconds,
            check=True,
            cwd="/",
            env=os.environ | _ONE_THREAD,
        )
    except (subprocess.SubprocessError, OSError) as error:
        said = (getattr(error, "stderr", None) or "").strip().splitlines()
        raise NoPeerError(f"{error}{': ' + said[-1] if said else ''}") from error
    return done.stdout
