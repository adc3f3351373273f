"""Evidence of a sound layer, changed as a test says, and what is decided by it."""

import numpy as np

from printctl.observe.deciding import Decider, Evidence, FlowBlocks, InkSupply, Limits, SupplyState
from registration.inspection.values import Gap

FLOWING = InkSupply(SupplyState.FLOWING, 0.0, None, 0)
GAP = Gap(2, 0.0, 1.0, (0.0, 0.0), (1.0, 0.0), 0.01, 1e-12)


def flow(ratio, count=30):
    full = np.full(count, ratio)
    return FlowBlocks(np.arange(float(count)), full, np.full(count, 0.02), np.ones(count))


def evidence(**changed):
    given = {"places": 400, "gaps": (), "second": None, "supply": FLOWING, "seen_share": 0.95}
    return Evidence(**{**given, "flow": flow(1.0), "way_mm": 100.0, **changed})


def decided(mode="mend", **changed):
    return Decider(Limits(mend=mode)).decide(evidence(**changed))
