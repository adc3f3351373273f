"""State of a decider: what it has learned so far, as each look's record keeps it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from printctl.observe.deciding import Decider, LayersSeen
from printctl.observe.deciding.answers import Answers, Reading
from printctl.observe.deciding.seen_flow import SeenFlow, SeenLevel
from registration.inspection.values import Gap


def state_of(decider: Decider) -> dict[str, Any]:
    """Return what `restore` needs, ready for JSON."""
    control = decider.control
    return {
        "log_flow": control.log_flow,
        "variance": control.variance,
        "time_s": control.time_s,
        "common": control.common,
        "answers": asdict(control.answers),
        "seen_flow": asdict(control.seen),
        "beyond_said": control.beyond_said,
        "layers": asdict(decider.layers),
        "last_shift_mm": decider.last_shift_mm,
    }


def restore(decider: Decider, state: dict[str, Any]) -> None:
    """Set a decider to a state of `state_of`; what an older release's lacks isn't known."""
    control = decider.control
    control.log_flow = state["log_flow"]
    control.variance, control.time_s = state["variance"], state["time_s"]
    control.common = state.get("common", 0.0)
    control.beyond_said = state.get("beyond_said", False)
    answers = dict(state.get("answers", {}))
    last = answers.pop("last", None)
    control.answers = Answers(**answers, last=None if last is None else Reading(**last))
    seen = dict(state.get("seen_flow", {}))
    for name in ("first", "last", "asked"):
        if seen.get(name) is not None:
            seen[name] = SeenLevel(**seen[name])
    control.seen = SeenFlow(**seen)
    layers = dict(state["layers"])
    for name in ("blank", "tail", "before_tail"):
        layers[name] = [Gap(**one) for one in layers.get(name, ())]
    decider.layers, decider.last_shift_mm = LayersSeen(**layers), state["last_shift_mm"]
