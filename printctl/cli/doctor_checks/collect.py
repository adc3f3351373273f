"""Examine this computer for `printctl doctor`: run all checks, collect facts and problems."""

from __future__ import annotations

import importlib
import os
import platform
import re
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from kernels import cache_dir
from printctl.cli.doctor_checks.finding import Finding
from printctl.cli.doctor_checks.places import (
    PAGE_PORT,
    clock_findings,
    disk_findings,
    free_gb,
    is_port_free,
    is_writable,
)
from printctl.cli.doctor_checks.ports import check_ports, group_of, permission_findings
from printctl.machine.link.history import data_folder
from printctl.machine.link.ports import list_ports

# List printctl's optional installs: present, or missing packages and the pip command.

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
    if not missing:
        return "present"
    return f"missing {', '.join(missing)}; pip install 'printctl[{extra}]'"


def _is_there(name: str) -> bool:
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


OURS: Final = ("kernels", "firmware_profiles", "design", "sim", "registration", "printctl")
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
