"""Entry of all benchmarks: ``python -m benchmarks SUBJECT [--quick] [--only PART]``.

Each subject's parts yield rows; they go to the standard error as they are measured, and one JSON
object to the output at the end. A part that needs what isn't here is skipped by name; one that
fails is named, the others still run, and the exit status is 1. ``--quick`` takes fewer or smaller
cases, at most 60 CPU s a subject. ``nightly`` runs the quick forms of all subjects in turn.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from importlib import import_module

from benchmarks.common import ROOT, Row, SkippedError, commit, machine, row

SUBJECTS: dict[str, dict[str, str]] = {
    "pipeline": {"recipes": "pipeline:rows"},
    "evidence": {"tampers": "evidence:rows"},
    "vasculature": {
        "gyrus": "vasculature.organs:gyrus_rows",
        "cube": "vasculature.organs:cube_rows",
        "biventricle": "vasculature.organs:biventricle_rows",
        "loops": "vasculature.organs:loop_rows",
        "printable": "vasculature.organs:printable_rows",
        "anatomy": "vasculature.anatomy:rows",
        "million": "vasculature.organs:million_rows",
        "ten_million": "vasculature.organs:ten_million_rows",
    },
    "tissue": {"supply": "tissue.run:rows"},
    "flow": {
        "steady": "flow.lumped:steady_rows",
        "oxygen": "flow.oxygen:rows",
        "lumens": "flow.lumens:rows",
        "loops": "flow.loops:rows",
        "openbf": "flow.openbf:rows",
    },
    "solids": {
        "slicing": "solids.slicing:rows",
        "bent": "solids.bent:rows",
        "organs": "solids.organs:rows",
        "large": "solids.slicing:large_rows",
    },
    "embedded": {"networks": "embedded.write:rows"},
    "link": {
        "speed": "link.real:speed_rows",
        "noise": "link.virtual:noise_rows",
        "kills": "link.virtual:kill_rows",
    },
    "operator": {
        "stop": "operator.stop:stop_rows",
        "slowing": "operator.stop:slowing_rows",
        "view": "operator.view:rows",
        "stop_door": "operator.stop_door:rows",
        "page": "operator.page:rows",
        "first_print": "operator.first_print:rows",
    },
    "observe": {
        name: f"observe.{name}:rows"
        for name in (
            "seeing",
            "scenes",
            "flows",
            "laser",
            "bath",
            "frames",
            "mends",
            "prints",
            "steps",
            "faults",
        )
    },
    "firmware": {
        name: f"firmware.rows:{name}"
        for name in ("noise", "faults", "stop", "looks", "speed", "dry_run")
    },
    "registration": {
        "whole": "registration.scans:whole_rows",
        "landing": "registration.scans:landing_rows",
        "diameters": "registration.scans:diameter_rows",
        "dye": "registration.dye:rows",
    },
    "identity": {"scans": "identity.rows:rows"},
    "scans": {"count": "scans.rows:rows"},
    "machines": {
        "aerotech": "machines.aerotech:rows",
        "network": "machines.network:rows",
        "profiles": "machines.profiles:profile_rows",
    },
    "paper": {
        "trees": "paper.trees:rows",
        "regions": "paper.regions:rows",
    },
}
NAMED_ONLY = {"million", "ten_million"}
"""Parts of minutes and gigabytes, which run where ``--only`` names them."""

QUICK_CPU_S, QUICK_WALL_S = 60.0, 1200.0
"""Of a subject's quick form: what it should take at most, and when it is broken off."""


def main() -> int:
    """Measure what the command line names; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("subject", choices=[*SUBJECTS, "nightly"])
    parser.add_argument("--quick", action="store_true", help="fewer or smaller cases")
    parser.add_argument("--only", metavar="PART", help="one part; see SUBJECTS for their names")
    given = parser.parse_args()
    if given.subject == "nightly":
        return nightly()
    parts = SUBJECTS[given.subject]
    if given.only not in (None, *parts):
        parser.error(f"{given.subject} has no part {given.only!r}; it has {', '.join(parts)}")
    return measure(parts, given.only, given.quick)


def measure(parts: dict[str, str], only: str | None, quick: bool) -> int:
    """Run the parts of a subject and print its JSON object; return 1 where one failed."""
    about = {"machine": machine(), "commit": commit(), "load_before": os.getloadavg()[0]}
    rows: list[Row] = []
    failed = False
    for name, place in parts.items():
        if only != name and (only is not None or name in NAMED_ONLY):
            continue
        module, _, function = place.partition(":")
        before = cpu_s()
        try:
            for found in getattr(import_module(f"benchmarks.{module}"), function)(quick):
                print(json.dumps(found, ensure_ascii=False), file=sys.stderr, flush=True)
                rows.append(found)
        except SkippedError as skipped:
            rows.append({"measure": name, "skipped": str(skipped)})
        except Exception as error:
            traceback.print_exc()
            failed = True
            rows.append({"measure": name, "error": f"{type(error).__name__}: {error}"})
        print(f"{name}: {cpu_s() - before:.1f} CPU s", file=sys.stderr, flush=True)
    print(json.dumps(about | {"cpu_s": cpu_s(), "rows": rows}, indent=1, ensure_ascii=False))
    return int(failed)


def cpu_s() -> float:
    """Return the CPU time of this process and its children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return round(sum(each.ru_utime + each.ru_stime for each in used), 1)


def nightly() -> int:
    """Run every subject's quick form; return 1 and name those that failed."""
    rows: list[Row] = []
    broken = []
    for subject in SUBJECTS:
        print(f"{subject} ...", file=sys.stderr, flush=True)
        begun, before = time.monotonic(), cpu_s()
        command = [sys.executable, "-m", "benchmarks", subject, "--quick"]
        with tempfile.TemporaryFile("w+") as told:
            process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=told)
            try:
                code = process.wait(QUICK_WALL_S)
            except subprocess.TimeoutExpired:
                process.kill()
                code = process.wait()
            told.seek(0)
            if code:
                print(told.read()[-5000:], file=sys.stderr)
                broken.append(subject)
        spent = cpu_s() - before
        found = row(subject, round(spent, 1), "CPU s", f"<= {QUICK_CPU_S:g}", spent <= QUICK_CPU_S)
        found |= {"ok": code == 0, "wall_s": round(time.monotonic() - begun)}
        print(json.dumps(found), file=sys.stderr, flush=True)
        rows.append(found)
    about = {"machine": machine(), "commit": commit(), "broken": broken}
    print(json.dumps(about | {"rows": rows}, indent=1))
    if broken:
        print(f"broken: {', '.join(broken)}", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
