"""Recipe keys that a click on the tissue sets, by kind of growth."""

from __future__ import annotations

from typing import Any

import pytest

from printctl.web.design.pick_targets import pick_targets
from printctl.web.design.widgets.pick_pane import place_of

LEFT = {"left_coronary": {"at_mm": [1, 2, 3]}}
HEART = {"template": "heart", "inlets": LEFT}
TREES = [{"kind": "artery"}, {"kind": "vein"}]


@pytest.mark.parametrize(
    ("vessels", "name", "path", "value"),
    [
        ({"grow": "tree"}, "a further inlet", ("inlets",), [{"at_mm": [0.1, 2.0, 3.0]}]),
        (
            {"grow": "tree", "inlets": [{"at_mm": [0, 0, 0], "direction": [0, 0, 1]}]},
            "inlet 1", ("inlets",), [{"at_mm": [0.1, 2.0, 3.0]}],
        ),
        ({"grow": "tree", "inlets": "each_part"}, "a further inlet", ("inlets",),
         [{"at_mm": [0.1, 2.0, 3.0]}]),
        (
            {"grow": "tree", "anatomy": HEART}, "right coronary", ("anatomy", "inlets"),
            {**LEFT, "right_coronary": {"at_mm": [0.1, 2.0, 3.0]}},
        ),
        ({"grow": "closed_loop"}, "the vein's outlet", ("vein_root_mm",), [0.1, 2.0, 3.0]),
        (
            {"grow": "forest", "networks": [{"network": "old.csv"}, {"trees": TREES}]},
            "network 2: vein 2", ("networks", 1, "trees", 1, "root_mm"), [0.1, 2.0, 3.0],
        ),
    ],
)  # fmt: skip
def test_a_place_goes_where_the_growth_looks_for_it(
    vessels: dict[str, Any], name: str, path: tuple[str | int, ...], value: Any
) -> None:
    data = {"vasculature": vessels}
    target = next(one for one in pick_targets(data) if one.name == name)
    assert target.path == ("vasculature", *path)
    assert target.value(data, [0.10004, 2.0, 3.0]) == value


@pytest.mark.parametrize(
    "given", [None, {}, {"at": [1, 2]}, {"at": [1, 2, "3"]}, {"at": [1, True, 3]},
              {"at": [1, 2, float("nan")]}, {"at": [1, 2, 1e9]}, [1, 2, 3]]
)  # fmt: skip
def test_what_a_frame_sends_is_a_place_or_nothing(given: Any) -> None:
    assert place_of(given) is None
    assert place_of({"at": [1, 2.5, -3]}) == [1.0, 2.5, -3.0]
