"""Run the command line as a user does, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"


def printctl(
    *args: str | Path, cwd: Path, preexec: Callable[[], None] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``printctl`` with ``args`` in ``cwd``; never longer than five minutes."""
    return subprocess.run(
        [sys.executable, "-m", "printctl", *map(str, args)],
        cwd=cwd,
        env=None,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        preexec_fn=preexec,
    )


def recipe_file(folder: Path, base: str, **sections: Any) -> Path:
    """Write a shipped example into ``folder`` with some of its sections changed."""
    data = yaml.safe_load((ROOT / "examples" / f"{base}.yaml").read_text())
    for section, changes in sections.items():
        old = data.get(section)
        merge = isinstance(old, dict) and isinstance(changes, dict) and "=" not in changes
        data[section] = {**old, **changes} if merge else changes
        if isinstance(data[section], dict):
            data[section].pop("=", None)
    path = folder / "recipe.yaml"
    path.write_text(yaml.safe_dump(data))
    return path
