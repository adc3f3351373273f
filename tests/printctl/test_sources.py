"""Child processes of ours import our own modules, whatever lies in the working folder."""

from __future__ import annotations

import subprocess
from pathlib import Path

from printctl.sources import python_command

ROOT = Path(__file__).resolve().parents[2]


def test_a_module_in_the_working_folder_is_not_run(tmp_path: Path) -> None:
    (tmp_path / "sim.py").write_text("print('from the working folder')")
    command = [*python_command("sim"), "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "from the working folder" not in done.stdout


def test_no_other_place_starts_a_module_of_ours() -> None:
    files = (
        path
        for room in ("printctl", "gcode", "sim", "registration")
        for path in (ROOT / room).rglob("*.py")
    )
    assert [path.name for path in files if 'sys.executable, "-m"' in path.read_text()] == []
