"""Contents of the installed wheel."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OURS = {"design", "firmware_profiles", "kernels", "printctl", "registration", "sim"}


@pytest.mark.slow
def test_wheel_has_our_packages_and_their_data_and_nothing_else(tmp_path: Path) -> None:
    # From a copy: setuptools leaves its build folder behind.
    source = tmp_path / "source"
    for package in OURS:
        shutil.copytree(ROOT / package, source / package)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", str(tmp_path)]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == OURS
    for needed in (
        "firmware_profiles/data/printers/generic_marlin.yaml",
        "printctl/recipe/starter.yaml",
        "printctl/py.typed",
    ):
        assert needed in names
    assert any(name.startswith("registration/report/vendor/") for name in names)
    assert any(name.startswith("registration/report/templates/") for name in names)
    assert "registration/report/viewer/page.js" in names
    assert "printctl/web/live/static/live_view.js" in names
