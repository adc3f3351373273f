"""Run the command line in a separate process, or in this one to save start-up time."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest
import yaml

from printctl.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"


def printctl(
    *args: str | Path, cwd: Path, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``printctl`` with ``args`` in ``cwd`` (and ``env``); never longer than twenty minutes."""
    return subprocess.run(
        [sys.executable, "-m", "printctl", *map(str, args)],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )


def called(*args: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run ``printctl`` with ``args`` in ``cwd`` by its entry: no signals, no limits of its own."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    words = ["printctl", *map(str, args)]
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.MonkeyPatch.context() as patch,
        warnings.catch_warnings(),
    ):
        # A simulated printer outlives its command.
        warnings.filterwarnings("ignore", r"subprocess \d+ is still running", ResourceWarning)
        patch.setattr(sys, "argv", words)
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


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
