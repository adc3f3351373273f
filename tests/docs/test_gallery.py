"""The gallery's maker on examples that can't be printed; a shipped heart that can."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import yaml

from design.tissue import biventricle
from docs_tools import gallery
from firmware_profiles import Needle, load

EXAMPLES = Path(__file__).parents[2] / "examples"
FLOW = {"flow": {"vessel_count": 7, "pressure_drop_mmhg": 2.5}}


def test_a_print_that_is_refused_is_shown_as_designed_with_the_reason(monkeypatch, tmp_path):
    """The gallery ended at a heart of 60 mm, deeper than its needle is long."""
    called: list[tuple[Any, ...]] = []

    def printctl(*words: Any) -> subprocess.CompletedProcess[str]:
        called.append(words)
        if words[0] == "run" and "--until" not in words:
            refusal = "tissue 1 s\nprintctl: refused:\ndepth 60 mm, limit 50\n"
            return subprocess.CompletedProcess(words, 3, "", refusal)
        return subprocess.CompletedProcess(words, 0, json.dumps(FLOW), "")

    monkeypatch.setattr(gallery, "_printctl", printctl)
    monkeypatch.setattr(gallery, "PICTURES", tmp_path)
    path = EXAMPLES / "liver_vessels.yaml"
    known = gallery.make(path)
    assert known["refused"] == "refused: depth 60 mm, limit 50"
    assert known["figures"] == {"vessels": "7", "pressure drop": "2.5 mmHg"}
    assert [words[0] for words in called] == ["run", "run", "view"]
    page = gallery.page({path.stem: known})
    assert "Shown as designed; the print is refused: refused: depth 60 mm, limit 50" in page


def test_the_needle_reaches_the_apex_of_the_shipped_heart() -> None:
    recipe = yaml.safe_load((EXAMPLES / "heart_coronaries.yaml").read_text(encoding="utf-8"))
    height = biventricle(recipe["tissue"]["length_mm"]).vertices[:, 2]
    needle = load(Needle, recipe["toolpath"]["needle"])
    assert needle.length_mm is not None
    assert float(height.max() - height.min()) < needle.length_mm
