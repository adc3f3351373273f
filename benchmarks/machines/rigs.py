"""Real network hosts on simulated motors: start, kill, restart, and count what was written.

NETWORK_HOSTS names a folder with virtual environments ``moonraker`` and ``octoprint`` (from PyPI),
``klippy`` (Klipper's requirements) and ``klipper``, its source with ``out/klipper.elf`` made for a
Linux process. The Duet is a twin of our own.
"""

from __future__ import annotations

import os
import shutil
import socket
import struct
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from datetime import datetime
from http.client import HTTPException
from pathlib import Path
from typing import ClassVar
from urllib.error import URLError
from urllib.request import Request, urlopen

from benchmarks.common import ROOT, SkippedError, needed

STROKES, LENGTH_MM, E_MM = 5, 8.0, 0.4
FIRST_Y_MM = 10
KEY = "5F0C6C2E9C4A4C0B8D2A7B1E3F445566"
STEPS_PER_MM = 20
_UP_S = 240.0


def job_text(frame: str, feed_mm_min: int) -> str:
    """Return a job of strokes, each at a Y of its own and named by its E; ``frame`` begins it."""
    lines = [*frame.splitlines(), "G90", "M82", "G92 E0"]
    for k in range(STROKES):
        lines.append(f"G1 X10 Y{FIRST_Y_MM + k} F1200")
        lines.append(f"G1 X{10 + LENGTH_MM:g} E{E_MM * (k + 1):.2f} F{feed_mm_min}")
    return "\n".join([*lines, "M400", ""])


def free_port() -> int:
    """Return a TCP port that nobody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def installed(name: str) -> Path:
    """Return a path under NETWORK_HOSTS, or skip."""
    folder = os.environ.get("NETWORK_HOSTS")
    if not folder:
        raise SkippedError("needs NETWORK_HOSTS, a folder of the hosts' programs")
    return needed(Path(folder) / name)


class Rig(ABC):
    """A host with its printer in a folder; subclasses say how it is started and counted."""

    kind: ClassVar[str]
    profile: ClassVar[str]
    frame: ClassVar[str] = "G92 X10 Y10 Z5"
    feed_mm_min: ClassVar[int] = 400

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_port()
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        folder.mkdir(parents=True)

    @abstractmethod
    def commands(self) -> dict[str, list[str]]:
        """Return the command of each program, in the order of their start."""

    def start(self) -> None:
        """Start what doesn't run, and wait until the host answers for its printer."""
        for name, command in self.commands().items():
            if name not in self.processes or self.processes[name].poll() is not None:
                with (self.folder / f"{name}.out").open("ab") as out:
                    self.processes[name] = subprocess.Popen(
                        command, stdout=out, stderr=out, stdin=subprocess.DEVNULL,
                        cwd=self.folder, env=os.environ | self.environment(),
                    )  # fmt: skip
                time.sleep(0.3)
        limit = time.monotonic() + _UP_S
        while not self.ready():
            if time.monotonic() > limit:
                raise TimeoutError(f"{self.kind} isn't up within {_UP_S:g} s")
            time.sleep(0.2)

    def environment(self) -> dict[str, str]:
        """Return what the programs' environment has besides."""
        return {}

    def kill(self, *names: str) -> None:
        """Kill programs, all without names."""
        for name in names or tuple(self.processes):
            self.processes[name].kill()
            self.processes[name].wait()

    def ask(self, path: str, data: bytes | None = None) -> bytes:
        """Ask the host itself; empty without an answer."""
        headers = {"X-Api-Key": KEY} if self.kind == "octoprint" else {}
        headers["Content-Type"] = "application/json"
        request = Request(f"http://127.0.0.1:{self.port}{path}", data, headers)
        try:
            with urlopen(request, timeout=5) as answer:
                return bytes(answer.read())
        except (URLError, OSError, HTTPException):
            return b""

    @abstractmethod
    def ready(self) -> bool:
        """Whether the host answers, and its printer with it."""

    def recover(self) -> None:
        """Make the printer ready for the next print, however the last one ended."""
        self.start()

    @abstractmethod
    def mark(self) -> None:
        """Count from here."""

    @abstractmethod
    def strokes(self) -> dict[int, float]:
        """Return how often each stroke was written since the mark, in parts of a stroke."""

    @abstractmethod
    def last_motion(self) -> float:
        """Return when the printer last moved, or was given a move, s since 1970."""

    def halted_at(self) -> float:
        """Return when the halt was there; the last motion where motors are seen."""
        return self.last_motion()


class KlipperRig(Rig):
    """Moonraker and Klipper; the micro-controller is Klipper's own, its pins are logged."""

    kind, profile = "moonraker", "klipper_bioprinter"
    frame = "SET_KINEMATIC_POSITION X=10 Y=10 Z=5"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        for path in ("data/config", "data/logs", "data/gcodes"):
            (folder / path).mkdir(parents=True)
        (folder / "temp").write_text("25000\n")
        axes = "".join(
            f"[stepper_{axis}]\nstep_pin: gpio{2 * k}\ndir_pin: gpio{2 * k + 1}\nmicrosteps: 1\n"
            f"endstop_pin: gpio{30 + k}\nposition_endstop: 0\nhoming_positive_dir: false\n"
            "position_min: -10\nposition_max: 200\nrotation_distance: 10\n"
            for k, axis in enumerate("xyz")
        )
        (folder / "printer.cfg").write_text(
            f"[mcu]\nserial: {folder}/mcu\n[printer]\nkinematics: cartesian\nmax_velocity: 300\n"
            f"max_accel: 3000\n{axes}[extruder]\nstep_pin: gpio6\ndir_pin: gpio7\n"
            f"heater_pin: gpio8\nsensor_type: temperature_host\nsensor_path: {folder}/temp\n"
            "min_temp: -100\nmax_temp: 300\nmin_extrude_temp: 0\ncontrol: watermark\n"
            "nozzle_diameter: 0.4\nfilament_diameter: 4.6\nmax_extrude_cross_section: 50\n"
            "microsteps: 1\nrotation_distance: 10\n[force_move]\nenable_force_move: True\n"
            f"[virtual_sdcard]\npath: {folder}/data/gcodes\n[pause_resume]\n"
        )
        (folder / "data/config/moonraker.conf").write_text(
            f"[server]\nhost: 127.0.0.1\nport: {self.port}\nklippy_uds_address: {folder}/klippy\n"
            "[machine]\nprovider: none\nvalidate_service: False\n[history]\n[file_manager]\n"
            "[authorization]\ntrusted_clients:\n    127.0.0.1\n"
        )
        source = Path(__file__).with_name("gpio_log.c")
        shim = ["-O2", "-shared", "-fPIC", "-o", str(folder / "gpio_log.so"), str(source), "-ldl"]
        subprocess.run([shutil.which("cc") or "cc", *shim], check=True)
        (folder / "gpio.bin").touch()  # the shim makes it at the first pin that moves
        self._begin = 0

    def commands(self) -> dict[str, list[str]]:
        """Micro-controller, Klipper's host, Moonraker."""
        python, source = installed("klippy/bin/python"), installed("klipper")
        first = ["nice", "-n", "-15"]  # in time on a busy machine, where that is allowed
        real_time = ["-r"] if os.geteuid() == 0 else []
        host = [*first, str(python), str(source / "klippy/klippy.py"), f"{self.folder}/printer.cfg"]
        mcu = [*first, "env", f"LD_PRELOAD={self.folder}/gpio_log.so"]
        return {
            "mcu": [
                *mcu,
                str(needed(source / "out/klipper.elf")),
                *real_time,
                "-I",
                f"{self.folder}/mcu",
            ],
            "klippy": [*host, "-l", f"{self.folder}/klippy.log", "-a", f"{self.folder}/klippy"],
            "moonraker": [str(installed("moonraker/bin/moonraker")), "-d", f"{self.folder}/data"],
        }

    def environment(self) -> dict[str, str]:
        """Where pins are logged."""
        return {"GPIO_LOG": f"{self.folder}/gpio.bin"}

    def ready(self) -> bool:
        """Whether Klipper is ready, or has halted: on a busy machine it may, by itself."""
        said = self.ask("/printer/info").replace(b": ", b":")
        return b'"state":"ready"' in said or b'"state":"shutdown"' in said

    def recover(self) -> None:
        """Restart Klipper and its micro-controller behind a halt."""
        self.kill("klippy", "mcu")
        (self.folder / "klippy").unlink(missing_ok=True)
        self.start()

    def _edges(self) -> list[tuple[int, int, int]]:
        with (self.folder / "gpio.bin").open("rb") as log:
            count = struct.unpack("<QII", log.read(16))[0]
            log.seek(16 * (1 + self._begin))
            data = log.read(16 * (count - self._begin))
        return list(struct.iter_unpack("<QII", data))

    def mark(self) -> None:
        """Count from here."""
        self._begin += len(self._edges())

    def strokes(self) -> dict[int, float]:
        """Count the plunger's rising edges at each Y of the motors."""
        found: dict[int, float] = {}
        y, sign = 0, 1
        for _, pin, value in self._edges():
            if pin == 3:
                sign = -1 if value else 1
            elif pin == 2 and value:
                y += sign
            elif pin == 6 and value:
                stroke = round(abs(y) / STEPS_PER_MM)
                found[stroke] = found.get(stroke, 0.0) + 1 / (E_MM * STEPS_PER_MM)
        return found

    def last_motion(self) -> float:
        """Return when a motor stepped last."""
        return max((ns for ns, pin, _ in self._edges() if pin in (0, 2, 4, 6)), default=0) / 1e9


class OctoPrintRig(Rig):
    """OctoPrint with its own virtual printer, whose log has what it received."""

    kind, profile = "octoprint", "generic_marlin"
    frame = "M302 P1\nG92 X10 Y10 Z5"
    feed_mm_min = 40  # its virtual printer takes a tenth of each move's time

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        (folder / "config.yaml").write_text(
            f"api: {{key: {KEY}}}\nserver:\n  firstRun: false\n  onlineCheck: {{enabled: false}}\n"
            "  pluginBlacklist: {enabled: false}\n  ignoreIncompleteStartup: true\n"
            "  seenWizards: {corewizard: 4}\n"
            "accessControl: {salt: abc}\nplugins:\n  virtual_printer: {enabled: true}\n"
            "  _disabled: [softwareupdate, announcements, tracking, backup, discovery, "
            "pluginmanager, errortracking, health_check, achievements]\n"
            "gcodeAnalysis: {runAt: never}\n"
            "serial: {autoconnect: true, port: VIRTUAL, baudrate: 115200}\n"
        )
        (folder / "gpio.bin").touch()  # the shim makes it at the first pin that moves
        self._begin = 0

    def commands(self) -> dict[str, list[str]]:
        """OctoPrint alone."""
        program = str(installed("octoprint/bin/octoprint"))
        place = ["-b", str(self.folder), "-c", str(self.folder / "config.yaml")]
        where = ["--host", "127.0.0.1", "--port", str(self.port), "--iknowwhatimdoing"]
        return {"octoprint": [program, "serve", *place, *where]}

    def ready(self) -> bool:
        """Whether the virtual printer is operational."""
        return b'"Operational"' in self.ask("/api/job")

    def recover(self) -> None:
        """Start it anew behind a halt: connected again it would log each line twice."""
        if not self.ready():
            self.kill()
        self.start()

    def _received(self) -> list[tuple[float, str]]:
        log = self.folder / "logs/plugin_virtual_printer_serial.log"
        lines = log.read_text(errors="replace").splitlines()[self._begin :] if log.exists() else []
        cut = [line.split(" <<< ") for line in lines if " <<< " in line]
        form = "%Y-%m-%d %H:%M:%S,%f"
        return [(datetime.strptime(at, form).timestamp(), text) for at, text in cut]

    def mark(self) -> None:
        """Count from here."""
        log = self.folder / "logs/plugin_virtual_printer_serial.log"
        self._begin = len(log.read_text(errors="replace").splitlines()) if log.exists() else 0

    def strokes(self) -> dict[int, float]:
        """Count the moves received, by their E."""
        return count_moves([text for _, text in self._received()])

    def last_motion(self) -> float:
        """Return when a move was received last."""
        return max((at for at, text in self._received() if "G1 " in text), default=0.0)

    def halted_at(self) -> float:
        """Return when M112 was received first."""
        return min((at for at, text in self._received() if "M112" in text), default=float("inf"))


class DuetRig(Rig):
    """The twin of a Duet without an SBC."""

    kind, profile, sbc = "duet", "ender5_duet3_replistruder5", False

    def commands(self) -> dict[str, list[str]]:
        """Run the twin alone."""
        twin = [sys.executable, "-m", "sim.devices.duet_twin", "--port", str(self.port)]
        own = ["--folder", str(self.folder), "--log", str(self.folder / "run.log")]
        return {"twin": [*twin, *own, *(["--sbc"] if self.sbc else [])]}

    def environment(self) -> dict[str, str]:
        """Where the twin's source is."""
        return {"PYTHONPATH": str(ROOT)}

    def ready(self) -> bool:
        """Whether it answers."""
        with socket.socket() as end:
            return end.connect_ex(("127.0.0.1", self.port)) == 0

    def recover(self) -> None:
        """Reset the board."""
        self.kill()
        self.start()

    def mark(self) -> None:
        """Count from here."""
        (self.folder / "run.log").unlink(missing_ok=True)

    def _run(self) -> list[tuple[float, str]]:
        log = self.folder / "run.log"
        cut = [line.split(" ", 1) for line in log.read_text().splitlines()] if log.exists() else []
        return [(float(at), text) for at, text in cut]

    def strokes(self) -> dict[int, float]:
        """Count the moves run, by their E."""
        return count_moves([text for _, text in self._run()])

    def last_motion(self) -> float:
        """Return when a move was begun last."""
        return max((at for at, text in self._run() if text.startswith("G1 ")), default=0.0)

    def halted_at(self) -> float:
        """Return when M112 arrived."""
        return min((at for at, text in self._run() if text == "M112"), default=float("inf"))


class DuetSbcRig(DuetRig):
    """The twin of a Duet with an SBC."""

    sbc = True


def count_moves(texts: list[str]) -> dict[int, float]:
    """Return how often each stroke's move is in texts."""
    found: dict[int, float] = {}
    for text in texts:
        words = [word for word in text.partition("*")[0].split() if word[0] == "E"]
        if "G1 " in text and words:
            stroke = round(float(words[0][1:]) / E_MM) - 1
            found[stroke] = found.get(stroke, 0.0) + 1
    return found
