"""`printctl flow --match-split`: adjust vessel radii until 3D flow divides as wanted."""

from __future__ import annotations

from pathlib import Path

from design.network import VesselNetwork
from printctl.analysis.flow.conditions import Driven
from printctl.analysis.flow.match import HISTORY, MATCHED, VESSELS, match_and_write, options_from
from printctl.analysis.flow.three_d import SHARP
from printctl.cli.flow_options import Match
from printctl.cli.flow_output import FlowOutput
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.recipe.parts import ThreeDPart

_PERCENT = 0.5


def match(
    network: VesselNetwork,
    driven: Driven,
    space: ThreeDPart,
    out: Path,
    fillet_ratio: float,
    how: Match,
    output: FlowOutput,
) -> None:
    """Match where it is asked for, and write the adjusted network and its history.

    Raises
    ------
    FlowError, SolidError, UsageError, OSError
        As `Driven.steady` and `match_and_write`.
    """
    if not how.match_split:
        return
    options = options_from(
        _PERCENT if how.match_percent is None else how.match_percent,
        how.least_lumen_mm or 0.0,
        space.edge_ratio,
        max(fillet_ratio, SHARP),
        space.inertia,
    )
    with messages().status("matching the split") as status:
        output.summary["match"] = match_and_write(
            out,
            network,
            driven.steady(network),
            _wanted(how.want or []),
            options,
            lambda _, doing: status.update(f"matching the split: {doing}"),
        )
    output.files += [out / MATCHED, out / HISTORY, out / VESSELS]
    _warn(output)


def _wanted(texts: list[str]) -> dict[int, float]:
    flows: dict[int, float] = {}
    for text in texts:
        node, _, flow = text.partition(",")
        try:
            flows[int(node)] = float(flow)
        except ValueError:
            raise UsageError(f"--want {text!r} isn't NODE,ML_MIN; write 4,0.05") from None
    return flows


def _warn(output: FlowOutput) -> None:
    result = output.summary["match"]
    if result["met"]:
        return
    bounds = result["vessels_at_a_bound"]
    why = f"vessels {bounds} stand at a bound of their radius" if bounds else "rounds bring no more"
    messages().print(
        f"the split isn't met: {result['worst_percent_of_inlet']:.2g} % of the inlet's flow is "
        f"left in vessel {result['worst_vessel']} ({why})",
        style="yellow",
        markup=False,
    )
