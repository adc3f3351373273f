"""Pass, fail, and what can't be told."""

from __future__ import annotations

from typing import Any

from printctl.pipeline.verdict import verdict


def vessel(number: int, **more: Any) -> dict[str, Any]:
    return {"vessel": number, "open": True, "error_percent": 1.0, **more}


def found(**more: Any) -> dict[str, Any]:
    return {
        "vessels": [vessel(0), vessel(1)],
        "scaled": {"rms_um": 10.0},
        "rigid": {"rms_um": 40.0},
        "ambiguity": {"flag": False},
        "defects": [],
        "perfusion": {
            "pressure_drop_pa": 12.0,
            "designed_pressure_drop_pa": 10.0,
            "vessels": [
                {"vessel": v, "fed": True, "share": 0.52, "designed_share": 0.5} for v in (0, 1)
            ],
        },
        **more,
    }


def defect(kind: str, **more: Any) -> dict[str, Any]:
    return {
        "kind": kind, "vessel": 1, "other": None, "at_mm": 2.0, "size_um": 200.0, "percent": None,
        **more,
    }  # fmt: skip


def judged(**more: Any) -> dict[str, Any]:
    return verdict(found(**more), 100.0, 10.0)


def test_good_print_passes_and_says_why() -> None:
    result = judged()
    assert result["passed"]
    assert not result["undecided"]
    assert any("1.20 times the designed pressure" in reason for reason in result["reasons"])


def test_closed_vessel_fails() -> None:
    result = judged(vessels=[vessel(0), vessel(1, open=False)])
    assert not result["passed"]
    assert not result["undecided"]
    assert "1 of 2 vessels not open: 1" in result["reasons"][0]


def test_unseen_vessel_is_neither_passed_nor_called_closed() -> None:
    result = judged(vessels=[vessel(0), vessel(1, open=None)])
    assert not result["passed"]
    assert result["undecided"]
    assert "neither open nor closed: 1" in result["reasons"][0]
    assert "not open" not in result["reasons"][0]


def test_unseen_vessel_beside_a_failure_is_a_failure() -> None:
    result = judged(vessels=[vessel(0, error_percent=-20.0), vessel(1, open=None)])
    assert not result["passed"]
    assert not result["undecided"]


def test_leak_fails_and_is_named() -> None:
    result = judged(defects=[defect("leak"), defect("bridge", other=0, size_um=100.0)])
    assert not result["passed"]
    (reason,) = [r for r in result["reasons"] if "leak" in r]
    assert "200 µm from vessel 1 (2.0 mm along) to the outside" in reason


def test_local_change_fails_only_beyond_the_tolerance() -> None:
    small = defect("bulge", percent=6.0)
    assert judged(defects=[small])["passed"]
    result = judged(defects=[small, defect("stenosis", percent=-50.0)])
    assert not result["passed"]
    assert any("1 beyond ±10 %" in reason for reason in result["reasons"])


def test_starved_vessel_fails() -> None:
    flow = found()["perfusion"]
    flow["vessels"][0]["fed"] = False
    result = judged(perfusion=flow)
    assert not result["passed"]
    assert any("carry no flow as printed: 0" in reason for reason in result["reasons"])


def test_older_report_without_defects_or_flow_is_still_judged() -> None:
    older = found()
    del older["defects"], older["perfusion"]
    assert verdict(older, 100.0, 10.0)["passed"]
