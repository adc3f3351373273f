"""Build wheel and sdist, and test the wheel in a clean environment.

    python .ci/dist.py build            # into dist/
    python .ci/dist.py try              # build, compare, install, run

The sdist builds the wheel; one built from the tree must hold the same. Downloads come from uv's
or pip's cache where they are in it.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
SMALLEST = b"G21\nG90\nM82\nG1 Z5 F300\nG1 X12 Y10 F1200\nG1 X14 Y12 F600\n"
START = "10,10,10"
EXAMPLES_OF_THE_GALLERY = """
import pathlib, yaml, printctl
package = pathlib.Path(printctl.__file__).parent
gallery = yaml.safe_load((package / "web" / "project" / "gallery.yaml").read_text())
names = [f"{one['example']}.yaml" for one in gallery]
missing = [name for name in names if not (package / "examples" / name).is_file()]
if missing or not names:
    raise SystemExit(f"the gallery has {len(names)} examples, and {missing} aren't in {package}")
"""
SIMULATED = ("--printer", "generic_marlin", "--port", "simulated")
WITHOUT_SOURCES = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def build(scratch: Path) -> Path:
    """Write sdist and, from it, the wheel; return the wheel."""
    shutil.rmtree(DIST, ignore_errors=True)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", DIST, tree(scratch))
    (wheel,) = DIST.glob("*.whl")
    return wheel


def tree(scratch: Path) -> Path:
    """A copy of the sources, as setuptools leaves folders of its own behind."""
    copy = scratch / "tree"
    if not copy.exists():
        unwanted = shutil.ignore_patterns(
            ".*", "*.egg-info", "build", "dist", "runs", "site", "__pycache__"
        )
        shutil.copytree(ROOT, copy, ignore=unwanted)
        describe = ("git", "-C", ROOT, "describe", "--always", "--dirty", "--exclude=*")
        commit = subprocess.run(describe, capture_output=True, text=True, check=False).stdout
        (copy / "printctl" / "build.txt").write_text(commit, encoding="utf-8")
    return copy


def contents(wheel: Path) -> dict[str, str]:
    """Every file of a wheel but the list of them, with its hash."""
    with zipfile.ZipFile(wheel) as opened:
        return {
            name: hashlib.sha256(opened.read(name)).hexdigest()
            for name in opened.namelist()
            if not name.endswith("RECORD")
        }


def same_from_tree(wheel: Path, scratch: Path) -> None:
    """Refuse a wheel of the sdist that differs from one of the tree."""
    run(
        sys.executable,
        "-m",
        "build",
        "--no-isolation",
        "--wheel",
        "--outdir",
        scratch / "wheel",
        tree(scratch),
    )
    (other,) = (scratch / "wheel").glob("*.whl")
    one, two = contents(wheel), contents(other)
    if one != two:
        wrong = sorted(name for name in one.keys() | two.keys() if one.get(name) != two.get(name))
        sys.exit(f"wheels of sdist and tree differ in {len(wrong)} files: {', '.join(wrong[:10])}")
    print(f"sdist and tree build the same wheel: {len(one)} files")


def try_out(wheel: Path, scratch: Path) -> None:
    """Install the wheel alone, and use it away from the sources."""
    begun = time.monotonic()
    home = scratch / "environment"
    venv.create(home, with_pip=True, system_site_packages=False)
    bin_folder = home / ("Scripts" if os.name == "nt" else "bin")
    run(sys.executable, ROOT / ".ci" / "install.py", bin_folder / "python", wheel)
    print(f"installed in {time.monotonic() - begun:.0f} s, downloads included")
    away = scratch / "away"
    away.mkdir()
    (away / "smallest.gcode").write_bytes(SMALLEST)
    # Kernels are those of the sources where versions are the same, else compiled.
    clean = WITHOUT_SOURCES | {"PRINTCTL_DATA": str(scratch / "data")}
    printctl = bin_folder / "printctl"
    for words in (
        ("--help",),
        ("doctor",),
        ("init", "recipe.yaml"),
        ("recipe", "migrate", "recipe.yaml"),
        ("print", "smallest.gcode", *SIMULATED, "--start", START, "--folder", "run"),
        ("status", "run"),
    ):
        print("printctl", *words, flush=True)
        done = subprocess.run(
            [printctl, *words], cwd=away, env=clean, capture_output=True, text=True, check=False
        )
        if done.returncode:
            said = f"{done.stdout}{done.stderr}"
            sys.exit(f"printctl {' '.join(words)} ended with {done.returncode}:\n{said}")
    gallery = [bin_folder / "python", "-c", EXAMPLES_OF_THE_GALLERY]
    if subprocess.run(gallery, cwd=away, env=clean, check=False).returncode:
        sys.exit("the installed page has nothing to begin with")
    if str(ROOT) in subprocess.check_output([printctl, "doctor"], cwd=away, env=clean, text=True):
        sys.exit("the installed printctl loads packages from the sources")
    print("the wheel works in an empty environment")


def run(*command: object) -> None:
    """Run quietly; show what it said when it fails."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=WITHOUT_SOURCES)
    if done.returncode:
        sys.exit(f"{' '.join(words)} ended with {done.returncode}:\n{done.stdout}{done.stderr}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        made = build(Path(folder))
        if sys.argv[1:] == ["try"]:
            same_from_tree(made, Path(folder))
            try_out(made, Path(folder))
