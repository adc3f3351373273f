"""Look at this installation, its folders and ports; say what to mend (`printctl doctor`)."""

from __future__ import annotations

import importlib
import os
import platform
import re
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from kernels import cache_dir
from printctl.machine.ports.detection import PortInfo, list_ports
from printctl.machine.records.folders import data_folder

DEVELOPMENT: Final = {"test", "release", "docs"}
"""Extras for those who work on printctl."""
_NAME: Final = re.compile(r"^[A-Za-z0-9._-]+")
_EXTRA: Final = re.compile(r"extra *== *['\"]([^'\"]+)['\"]")


def extras() -> dict[str, str]:
    """Each extra: "present", or what is missing and the command that installs it."""
    try:
        wanted = metadata.requires("printctl") or []
    except metadata.PackageNotFoundError:
        return {}
    parts: dict[str, list[str]] = {}
    for line in wanted:
        name, extra = _NAME.match(line), _EXTRA.search(line)
        if name and extra and extra[1] not in DEVELOPMENT:
            parts.setdefault(extra[1], []).append(name[0])
    return {extra: _said(extra, names) for extra, names in sorted(parts.items())}


def _said(extra: str, names: list[str]) -> str:
    missing = sorted(name for name in names if not _is_there(name))
    install = f"pip install 'printctl[{extra}]'"
    return f"missing {', '.join(missing)}; {install}" if missing else "present"


def _is_there(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


OURS: Final = (
    "kernels",
    "firmware_profiles",
    "design",
    "gcode",
    "sim",
    "registration",
    "report",
    "printctl",
)
LEAST_PYTHON: Final = (3, 11)
LIBRARIES: Final = (
    "numpy",
    "scipy",
    "numba",
    "trimesh",
    "manifold3d",
    "pyserial",
    "pydantic",
    "typer",
)
Facts = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Finding:
    """What is wrong and what to do.

    Attributes
    ----------
    text : str
    blocks : bool
        Whether printctl can't work on this machine until it is mended.
    """

    text: str
    blocks: bool = False


@dataclass(frozen=True)
class Examination:
    """Result of examining this computer: facts by section, and findings."""

    facts: Facts
    findings: tuple[Finding, ...]

    @property
    def blocked(self) -> bool:
        """Whether something keeps printctl from working here."""
        return any(finding.blocks for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        findings = [{"text": one.text, "blocks": one.blocks} for one in self.findings]
        return {**self.facts, "findings": findings, "fit": not self.blocked}


def examine() -> Examination:
    """Look at this machine; nothing is changed, and no port is opened."""
    ours, missing_ours = _ours()
    libraries, missing = _libraries()
    places, of_places = _places(Path.cwd(), data_folder())
    kernels, of_kernels = _kernels(cache_dir())
    ports = list_ports()
    now = datetime.now(tz=UTC)
    page_free = is_port_free(PAGE_PORT)
    facts: Facts = {
        "machine": {
            "python": f"{platform.python_version()} ({sys.executable})",
            "system": platform.platform(),
            "cores": os.cpu_count(),
            "clock": f"{now:%Y-%m-%d %H:%M:%S} UTC",
            "OpenGL": "not needed: pictures are drawn without it, 3D views by the browser",
        },
        "our packages, loaded from": ours,
        "libraries": libraries,
        "extras": extras(),
        "folders": places,
        "kernels": kernels,
        "operator's page": {f"port {PAGE_PORT}": "free" if page_free else "taken"},
        "ports": check_ports(ports),
    }
    findings = [
        *_python(),
        *missing_ours,
        *missing,
        *of_places,
        *of_kernels,
        *clock_findings(now),
        *permission_findings(ports, group_of),
    ]
    if not page_free:
        findings.append(
            Finding(
                f"port {PAGE_PORT} is taken, perhaps by a page that runs: `printctl serve "
                "--port 8081` takes another"
            )
        )
    return Examination(facts, tuple(findings))


def _python() -> list[Finding]:
    if sys.version_info >= LEAST_PYTHON:
        return []
    needed = ".".join(map(str, LEAST_PYTHON))
    return [Finding(f"Python {platform.python_version()} is older than {needed}", True)]


def _ours() -> tuple[dict[str, str], list[Finding]]:
    """Where our packages come from; another's of the same name may stand in the way."""
    folders = {
        name: str(Path(importlib.import_module(name).__file__ or "?").parent) for name in OURS
    }
    homes = {str(Path(place).parent) for place in folders.values()}
    if len(homes) == 1:
        return folders, []
    return folders, [
        Finding(
            f"our packages come from {len(homes)} places ({', '.join(sorted(homes))}): another's "
            "of the same name, or two versions; use an environment of its own",
            True,
        )
    ]


def _libraries() -> tuple[dict[str, str], list[Finding]]:
    versions, missing = {}, []
    for name in LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "missing"
            missing.append(Finding(f"{name} is missing; pip install printctl again", True))
    return versions, missing


def _places(here: Path, data: Path) -> tuple[dict[str, str], list[Finding]]:
    places, findings = {}, []
    for name, place in (("here", here), ("data", data)):
        free, writable = free_gb(place), is_writable(place)
        places[name] = f"{place} ({free:.1f} GB free, {'writable' if writable else 'read only'})"
        findings += disk_findings(name, place, free)
        if not writable and name == "data":
            findings.append(
                Finding(
                    f"no file can be written in {place}, where prints are remembered; see to its "
                    "rights, or name another folder in PRINTCTL_DATA",
                    True,
                )
            )
    return places, findings


def _kernels(folder: Path) -> tuple[dict[str, Any], list[Finding]]:
    count = sum(1 for _ in folder.rglob("*.nbc")) if folder.is_dir() else 0
    facts = {"cache": str(folder), "compiled": count}
    findings = (
        []
        if count
        else [
            Finding(
                "no kernel is compiled yet: the first run takes minutes; printctl doctor --warm"
            )
        ]
    )
    if not is_writable(folder):
        findings.append(
            Finding(
                f"kernels can't be kept in {folder}: every run compiles them anew; see to its "
                "rights, or name another folder in PRINTCTL_CACHE"
            )
        )
    return facts, findings


LOW_GB: Final = 5.0
"""A scan and its report take some; below this the user is told."""
FULL_GB: Final = 0.2
"""Below this a print's journal may not find room, and nothing is started."""
PAGE_PORT: Final = 8080
OLDEST_CLOCK: Final = datetime(2025, 1, 1, tzinfo=UTC)
"""A clock before this has lost its battery."""


def nearest(folder: Path) -> Path:
    """The folder, or the first above it that is there."""
    return next(place for place in (folder, *folder.parents) if place.is_dir())


def free_gb(folder: Path) -> float:
    """What is free on the folder's disk, GB, whether or not the folder is there yet."""
    return shutil.disk_usage(nearest(folder)).free / 1e9


def disk_findings(name: str, folder: Path, free: float) -> list[Finding]:
    """Whether ``free`` GB will do."""
    if free < FULL_GB:
        return [Finding(f"the disk of {folder} ({name}) has {free:.2f} GB left; free some", True)]
    if free < LOW_GB:
        return [Finding(f"the disk of {folder} ({name}) has {free:.1f} GB left")]
    return []


def is_writable(folder: Path) -> bool:
    """Whether a file can be made in the folder, or in the first above it that is there."""
    try:
        with tempfile.TemporaryFile(dir=nearest(folder)):
            return True
    except OSError:
        return False


def is_port_free(port: int) -> bool:
    """Whether a server could listen at the port on this machine's own address."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def clock_findings(now: datetime) -> list[Finding]:
    """Whether the clock can be right: journals and viability count by it."""
    if now >= OLDEST_CLOCK:
        return []
    return [Finding(f"the clock says {now:%Y-%m-%d}; set it: records of prints bear its time")]


MayOpen = Callable[[str], bool]


def may_open(device: str) -> bool:
    """Whether this user may read and write the device; Windows says so only on opening it."""
    return sys.platform == "win32" or os.access(device, os.R_OK | os.W_OK)


def check_ports(ports: Sequence[PortInfo], may: MayOpen = may_open) -> dict[str, str]:
    """Each port with its USB id, and whether it may be opened."""
    return {
        port.device: ", ".join(
            [
                port.usb_id or "no USB id",
                "readable and writable" if may(port.device) else "no permission",
            ]
        )
        for port in ports
    }


def permission_findings(
    ports: Sequence[PortInfo], group_of: Callable[[str], str], may: MayOpen = may_open
) -> list[Finding]:
    """What to do about each port that may not be opened.

    Parameters
    ----------
    ports : sequence of PortInfo
    group_of : function
        Name of the group that a device belongs to.
    may : function
    """
    return [Finding(_remedy(port, group_of(port.device))) for port in ports if not may(port.device)]


def group_of(device: str) -> str:
    """Name of the device's group; the usual one where that can't be found out."""
    try:
        return Path(device).group()
    except (KeyError, NotImplementedError, OSError):
        return "dialout"


def udev_rule(usb_id: str) -> str:
    """A rule that lets whoever sits at the machine open a device of this USB id."""
    vendor, product = usb_id.split(":")
    return (
        f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
        'TAG+="uaccess", ENV{ID_MM_DEVICE_IGNORE}="1"'
    )


def _remedy(port: PortInfo, group: str) -> str:
    text = f"you may not open {port.device}"
    if not sys.platform.startswith("linux"):
        return f"{text}; see to its rights"
    joined = f"`sudo usermod -aG {group} $USER`, then log out and in again"
    if group == "root" or not port.usb_id:
        joined = "`sudo usermod -aG dialout $USER` (on Arch uucp), then log out and in again"
    rule = ""
    if port.usb_id:
        rule = (
            "; or write this line into /etc/udev/rules.d/70-printctl.rules, plug the printer in "
            f"anew, and nothing else takes the port for a modem: {udev_rule(port.usb_id)}"
        )
    return f"{text}: {joined}{rule}"
