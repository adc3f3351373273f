"""Audit the pinned dependencies for known vulnerabilities: `python .ci/audit.py`.

pip-audit asks PyPI, then OSV. Vulnerable pins fail, and so does an audit that no service answered,
unless `--if-reachable` is given, as CI does: a build without a network isn't a vulnerable one.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PINS = Path(__file__).resolve().parents[1] / "constraints.txt"
SERVICES = ("pypi", "osv")
PATIENCE_S = 90


@dataclass(frozen=True)
class Answer:
    """What a service said: how many pins it knew, which it didn't, and what is vulnerable."""

    known: int
    unknown: tuple[str, ...]
    vulnerable: tuple[str, ...]


def read(told: dict[str, Any]) -> Answer:
    """The answer in pip-audit's JSON."""
    known, unknown, vulnerable = 0, [], []
    for one in told["dependencies"]:
        if "skip_reason" in one:
            unknown.append(one["name"])
            continue
        known += 1
        for found in one["vulns"]:
            mended = ", ".join(found["fix_versions"]) or "no version yet"
            vulnerable.append(f"{one['name']} {one['version']}: {found['id']} (fixed in {mended})")
    return Answer(known, tuple(unknown), tuple(vulnerable))


def ask(service: str) -> Answer | None:
    """Ask one service about all pins; None when it doesn't answer."""
    command = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off"]
    command += ["--vulnerability-service", service, "--no-deps", "--disable-pip"]
    try:
        done = subprocess.run(
            [*command, "--timeout", "10", "--requirement", str(PINS)],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
        return read(json.loads(done.stdout))
    except (subprocess.TimeoutExpired, json.JSONDecodeError):
        return None


def main() -> int:
    """Ask each service until one knows our pins."""
    for service in SERVICES:
        answer = ask(service)
        if answer is None or not answer.known:
            print(f"audit: {service} can't be reached from here")
            continue
        for line in answer.vulnerable:
            print(f"audit: {line}")
        missing = f", {len(answer.unknown)} unknown to it" if answer.unknown else ""
        count = len(answer.vulnerable)
        print(f"audit: {answer.known} pins asked of {service}{missing}: {count} vulnerable")
        return 1 if count else 0
    print("audit: NOT DONE, as no service answered; run `make audit` where there is a network")
    return 0 if "--if-reachable" in sys.argv else 2


if __name__ == "__main__":
    sys.exit(main())
