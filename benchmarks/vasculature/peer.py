"""svv in an environment of its own, outside the repository, with one thread for linear algebra.

With more threads it is five times slower, its optimiser's matrices being 2 x 2.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from benchmarks.common import Row, SkippedError

VERSION = "0.0.57"
SCRIPT = Path(__file__).with_name("svv.py")
ENVIRONMENT = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "SVV_TELEMETRY_DISABLED"), "1"
)
FOLDER = Path.home() / ".cache" / "printctl-bench" / f"svv-{VERSION}"


def grow_svv(terminals: int, side_mm: float, flow_ul_s: float, out: Path) -> Row:
    """Grow svv's tree in a cube and write it; install svv at the first call, or skip.

    Returns its seconds and CPU seconds of growth.
    """
    python = FOLDER / "bin" / "python"
    if not python.exists():
        _run([sys.executable, "-m", "venv", str(FOLDER)], 120)
        wanted = [f"svv=={VERSION}", f"svv-accelerated=={VERSION}"]
        _run([str(python), "-m", "pip", "install", "--quiet", *wanted], 1800)
    text = _run([str(python), str(SCRIPT), *map(str, (terminals, side_mm, flow_ul_s, out))], 3600)
    found: Row = json.loads(text.strip().splitlines()[-1])
    return found


def _run(command: list[str], seconds: float) -> str:
    env = os.environ | ENVIRONMENT
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds, check=True, cwd="/", env=env
        )
    except (subprocess.SubprocessError, OSError) as error:
        said = (getattr(error, "stderr", None) or "").strip().splitlines()
        raise SkippedError(f"needs svv {VERSION}: {said[-1] if said else error}") from error
    return done.stdout
