"""Run the examples and build their gallery page: `python -m docs_tools.gallery [NAME ...]`.

Each example runs as a user would run it; its picture is drawn by `printctl view --png`, its figures
come from its report.json. What takes longer than `AT_MOST_S` keeps the picture and the figures that
it had. A print that is refused is shown as designed, with the reason.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from design.files import write_text

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "gallery.md"
PICTURES: Final = ROOT / "docs" / "images" / "gallery"
FIGURES: Final = PICTURES / "figures.json"
RUNS: Final = ROOT / "runs" / "gallery"
AT_MOST_S: Final = 420
_DESIGNED: Final = "measures"
"""Last stage before anything is printed."""
HEAD: Final = """# Gallery

The shipped examples, run by `make gallery` as they stand: on the simulated printer and scanner, so
that every figure is of a simulation, never of a real print. Vessels are coloured by how far their
diameter, as scanned, is off the design; where nothing was scanned, by radius.
"""


def recipes() -> list[Path]:
    """Every shipped example."""
    return sorted((ROOT / "examples").glob("*.yaml"))


def make(path: Path) -> dict[str, Any]:
    """Run one example and draw it; what is to be said of it.

    Raises
    ------
    subprocess.TimeoutExpired
        When it takes longer than `AT_MOST_S`.
    subprocess.CalledProcessError
        When it fails otherwise than by a print that is refused or doesn't pass.
    """
    folder = RUNS / path.stem
    done = _printctl("run", path, "--out", folder, "--json")
    refused = ""
    if done.returncode > 1 or not done.stdout:
        refused = _last_words(done.stderr)
        done = _printctl("run", path, "--out", folder, "--json", "--until", _DESIGNED)
    if done.returncode > 1 or not done.stdout:
        raise subprocess.CalledProcessError(done.returncode, path.stem, done.stdout, done.stderr)
    report = json.loads(done.stdout)
    scanned = bool(report.get("registration"))
    picture = PICTURES / f"{path.stem}.png"
    drawn = _printctl(
        "view", folder, "--png", picture, "--width", 900,
        "--colour", "deviation" if scanned else "radius",
    )  # fmt: skip
    drawn.check_returncode()
    known = {"figures": figures(report), "made": f"{datetime.now(tz=UTC):%Y-%m-%d}"}
    return known | ({"refused": refused} if refused else {})


def _last_words(text: str) -> str:
    """What a command that failed says last, on one line."""
    return " ".join(text.rpartition("printctl: ")[2].split())


def figures(report: Mapping[str, Any]) -> dict[str, str]:
    """What one would ask first, out of report.json; what isn't there is left out."""
    told = dict(_figures(report))
    return {name: value for name, value in told.items() if value}


def _figures(report: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    verdict = report.get("verdict") or {}
    if verdict:
        yield "verdict", "pass" if verdict["passed"] else "fail"
    flow = report.get("flow") or {}
    if "vessel_count" in flow:
        yield "vessels", f"{flow['vessel_count']:.0f}"
    if "pressure_drop_mmhg" in flow:
        yield "pressure drop", f"{flow['pressure_drop_mmhg']:.3g} mmHg"
    dry = report.get("dry_run") or {}
    if dry.get("duration_s"):
        yield "print", f"{dry['duration_s'] / 60:.0f} min"
    found = report.get("registration") or {}
    if found.get("scaled"):
        yield "RMS deviation", f"{found['scaled']['rms_um']:.0f} µm"
    vessels = [one for one in found.get("vessels") or [] if one.get("error_percent") is not None]
    if vessels:
        worst = max(vessels, key=lambda one: abs(one["error_percent"]))
        yield "worst diameter", f"{worst['error_percent']:+.1f} %"
        yield "open", "all" if found.get("all_open") else "not all"


def page(known: Mapping[str, Mapping[str, Any]]) -> str:
    """The page, of what is known of each example."""
    made = [_section(path, known[path.stem]) for path in recipes() if path.stem in known]
    rest = ", ".join(f"`{path.stem}`" for path in recipes() if path.stem not in known)
    missing = ["## Not in the gallery yet", "", f"{rest}: `make gallery NAMES=NAME` adds one.", ""]
    return "\n".join([HEAD, *made, *(missing if rest else [])])


def about(path: Path) -> str:
    """The comment that a recipe begins with."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return " ".join(lines)


def _section(path: Path, known: Mapping[str, Any]) -> str:
    figures = "; ".join(f"{name} {value}" for name, value in known["figures"].items())
    parts = [f"## {path.stem}", "", about(path), ""]
    parts += [f"![{path.stem}: vessels in colour](images/gallery/{path.stem}.png)", ""]
    parts += [f"*{figures}; `printctl run examples/{path.name}`, {known['made']}.*", ""]
    if "refused" in known:
        parts += [f"Shown as designed; the print is refused: {known['refused']}", ""]
    return "\n".join(parts)


def _printctl(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "printctl", *map(str, words)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=AT_MOST_S
    )


def main(names: list[str]) -> None:
    """Make the examples of these names, or all, then the page."""
    known = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    PICTURES.mkdir(parents=True, exist_ok=True)
    for path in recipes():
        if names and path.stem not in names:
            continue
        try:
            known[path.stem] = make(path)
            print(path.stem, known[path.stem], flush=True)
        except subprocess.TimeoutExpired:
            print(f"{path.stem}: longer than {AT_MOST_S} s; left as it was", flush=True)
        except subprocess.CalledProcessError as exc:
            print(f"{path.stem}: {(exc.stderr or str(exc)).strip()[-400:]}", flush=True)
        write_text(FIGURES, json.dumps(known, indent=1, sort_keys=True, ensure_ascii=False) + "\n")
    write_text(PAGE, page(known))


if __name__ == "__main__":
    main(sys.argv[1:])
