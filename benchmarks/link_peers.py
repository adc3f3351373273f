"""Install and run other printer hosts in their own environments (GPL: run, not imported)."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.checkers.link_order import body_of, unreached
from benchmarks.link_files import zigzag
from benchmarks.link_printers import PeerFailedError, answerer, read_record, simulated
from benchmarks.link_runs import ends_of
from benchmarks.machine import row
from sim.gcode.motion.executed import ExecutedMotion

Row = dict[str, Any]


@dataclass(frozen=True)
class Peer:
    """A host that another project made.

    Attributes
    ----------
    name, version : str
    wanted : tuple of str
        What pip is told to install.
    script : str
        Of this folder: takes a port and a file, prints a JSON line.
    proof : str
        Import that shows that it is installed.
    """

    name: str
    version: str
    wanted: tuple[str, ...]
    script: str
    proof: str

    def python(self) -> Path:
        """The interpreter that has it; installs it at the first call.

        Raises
        ------
        PeerFailedError
            When it can't be installed.
        """
        folder = Path.home() / ".cache" / "printctl-bench" / f"{self.name}-{self.version}"
        python = folder / "bin" / "python"
        if not self._installed(python):
            _run([sys.executable, "-m", "venv", str(folder)], 120)
            _run([str(python), "-m", "pip", "install", "--quiet", *self.wanted], 900)
            if not self._installed(python):
                raise PeerFailedError(f"{self.name} was installed but can't be imported")
        return python

    def _installed(self, python: Path) -> bool:
        if not python.exists():
            return False
        check = [str(python), "-c", f"import {self.proof}"]
        return subprocess.run(check, capture_output=True, check=False).returncode == 0

    def print(self, port: str, job: Path) -> dict[str, Any]:
        """Print a file; what the script says."""
        script = Path(__file__).with_name(self.script)
        text = _run([str(self.python()), str(script), port, str(job)], 300)
        found: dict[str, Any] = json.loads(text.strip().splitlines()[-1])
        return found


PRINTCORE = Peer(
    "printcore",
    "2.0.1",
    # Its other dependencies (wxPython, dbus) are of its windows.
    ("--no-deps", "printrun==2.0.1", "pyserial", "platformdirs", "psutil", "lxml"),
    "link_printcore.py",
    "printrun.printcore",
)
OCTOPRINT = Peer(
    "octoprint", "1.11.8", ("octoprint==1.11.8",), "link_octoprint.py", "octoprint.util.comm"
)


def peer_rows(peer: Peer, lines: int, folder: Path) -> Iterator[Row]:
    """A peer against the answering printer and through the simulated one."""
    name = f"peer: {peer.name} {peer.version}"
    file, record = zigzag(lines), folder / f"{peer.name}.json"
    job = file.write(folder / f"{peer.name}.gcode")
    peer.python()
    with answerer(record) as port:
        used = peer.print(port, job)
    known = set(file.lines)
    taken = [(when, body_of(text)[1].strip()) for when, text in read_record(record)]
    times = [when for when, text in taken if text in known]
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
    yield row(f"{name}, {lines:,} lines to the answering peer", round(rate), "lines/s") | {
        "clock": "wall",
        "cpu_us_per_line": round(1e6 * used["cpu_s"] / lines, 1),
        "lines_taken": len(times),
    }
    motion = folder / f"{peer.name}.npz"
    with simulated("generic_marlin", "--record", str(motion)) as port:
        peer.print(port, job)
    missing, surplus = unreached(file.ends, ends_of(ExecutedMotion.load(motion)))
    made = row(
        f"{name} through the simulated printer: moves missing or too many",
        missing + surplus,
        f"of {lines}",
        "0",
        not missing + surplus,
    )
    yield made | {"clock": "wall", "missing": missing, "surplus": surplus}


def _run(command: list[str], seconds: float) -> str:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds, check=True, cwd="/"
        )
    except (subprocess.SubprocessError, OSError) as error:
        said = str(getattr(error, "stderr", "") or "").strip().splitlines()
        raise PeerFailedError(f"{error}{': ' + said[-1] if said else ''}") from error
    return done.stdout
