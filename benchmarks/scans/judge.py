"""Judge a `printctl register` report against a synthetic scan's truth.

python -m benchmarks.scans.judge REPORT_DIR TRUTH.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.scans.judge_defects import judge_defects, judge_verdict
from benchmarks.scans.judge_faces import judge_faces
from benchmarks.scans.judge_intervals import judge_intervals
from benchmarks.scans.judge_pose import best_equivalent, judge_pose
from benchmarks.scans.judge_vessels import judge_vessels


def judge(folder: Path, truth: dict[str, Any], tolerance: float = 10.0) -> dict[str, Any]:
    """Return the judgement; diameters and faces only where the pose is near the truth."""
    whole = json.loads((folder / "registration.json").read_text())
    report = whole["registration"]
    pose = judge_pose(report, truth)
    turn, _ = best_equivalent(report, truth)
    out: dict[str, Any] = {"pose": pose, "verdict": judge_verdict(whole, truth, tolerance)}
    out["defects"] = judge_defects(report, truth, turn, tolerance)
    placed = pose["tre_rms_um"] < 300
    out["quantities"] = judge_intervals(report, truth, pose["turned"]) if placed else []
    out["vessels"] = (
        judge_vessels(report, truth, tolerance) if placed and not pose["turned"] else []
    )
    out["faces"] = judge_faces(folder / "deviation.ply", report, truth) if placed else []
    return out


def main(argv: list[str] | None = None) -> int:
    """Print the judgement as JSON; exit 1 where something is silently wrong."""
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("report", type=Path)
    ap.add_argument("truth", type=Path)
    ap.add_argument("--tolerance-percent", type=float, default=10.0)
    asked = ap.parse_args(argv)
    result = judge(asked.report, json.loads(asked.truth.read_text()), asked.tolerance_percent)
    print(json.dumps(result))
    return int(result["pose"]["silently_wrong"] or result["verdict"]["false_pass"])


if __name__ == "__main__":
    sys.exit(main())
