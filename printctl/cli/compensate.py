"""`printctl compensate`: write toolpath corrections for the next print from registered prints."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.corrections.compensation import (
    CompensationFile,
    GainPart,
    changes_line,
    check_suffix,
    save_compensation,
)
from printctl.corrections.feedback import Choices, Mean, estimate, read_print
from printctl.errors import UsageError
from printctl.settings import arg, opt


@command
def compensate(
    prints: list[Path] = arg(
        "Finished runs of one design, or folders of `register --model RUN --out`.", metavar="RUN..."
    ),
    out: Path = opt("The file, .yaml or .json.", ...),
    depth_standard: str | None = opt(
        "What known height stands behind the scans' depth, where they don't say; without one "
        "depth isn't corrected.",
        metavar="TEXT",
    ),
    diameter_bias_um: str | None = opt(
        "Of this scanner on a phantom: measured less true, and its 95 % half width.",
        metavar="BIAS,INTERVAL",
    ),
    gain: float = opt("Share of scale and radial offset corrected at once.", 1.0),
    local_gain: float = opt("Share of local corrections made at once.", 0.7),
    without_vessel: list[int] | None = opt("A vessel to leave out; may be repeated."),
    whole_only: bool = opt("Nothing for single vessels and nodes.", False),
    as_json: JsonFlag = False,
) -> None:
    """Make a compensation from registered prints, for a recipe's `toolpath.compensation`.

    What isn't told from chance isn't corrected. Beyond 10 % of size, 20 % or 150 µm of a diameter,
    or 150 µm of place nothing is.
    """
    check_suffix(out)
    choices = Choices(
        gain=_gain(gain, local_gain),
        depth_standard=_said(depth_standard),
        bias=_bias(diameter_bias_um),
        without=frozenset(without_vessel or ()),
        local=not whole_only,
    )
    read = [read_print(folder) for folder in prints]
    _check_vessels(choices.without, read[0].network.vessel_count)
    made = estimate(read, choices)
    save_compensation(out, made)
    for note in made.notes:
        messages().print(f"note: {note}", markup=False)
    if as_json:
        print_json(made.model_dump(mode="json", by_alias=True))
    else:
        print_lines(*_measured(made), f"written instead: {changes_line(made)}", str(out))


def _measured(made: CompensationFile) -> list[str]:
    """What was found, each with its interval."""
    scale, diameter = made.evidence["scale"], made.evidence["diameter"]
    sizes = ", ".join(
        f"{axis} {100 * (one['size'] - 1):+.2f} ± {100 * one['interval_95']:.2f} %"
        for axis, one in scale.items()
    )
    count = len(made.prints)
    return [
        f"{count} print{'' if count == 1 else 's'}: size {sizes}",
        f"diameters {diameter['excess_um']:+.1f} ± {diameter['interval_95_um']:.1f} µm "
        f"once size is corrected ({'corrected' if diameter['corrected'] else 'not corrected'})",
    ]


def _gain(whole: float, local: float) -> GainPart:
    try:
        return GainPart(whole=whole, local=local)
    except ValidationError as exc:
        raise UsageError(
            f"--gain {whole:g} and --local-gain {local:g} must lie above 0 and be at most 1: more "
            "than what was measured is never corrected"
        ) from exc


def _said(text: str | None) -> str | None:
    if text is not None and not text.strip():
        raise UsageError("--depth-standard is empty; say what it is, e.g. 'step of 1.00 mm in gel'")
    return text


def _bias(text: str | None) -> Mean | None:
    if text is None:
        return None
    try:
        value, half = (float(part) * 1e-3 for part in text.split(","))
    except ValueError as exc:
        raise UsageError(
            f"--diameter-bias-um {text!r} isn't BIAS,INTERVAL in um; write it like -12,3"
        ) from exc
    if not (abs(value) < 1 and 0 <= half < 1):
        raise UsageError(
            f"--diameter-bias-um {text}: a bias within 1000 um and an interval of 0 to 1000 um are "
            "needed"
        )
    return Mean(value, half)


def _check_vessels(without: frozenset[int], count: int) -> None:
    wrong = sorted(vessel for vessel in without if not 0 <= vessel < count)
    if wrong:
        raise UsageError(f"--without-vessel {wrong[0]}: the network has vessels 0 to {count - 1}")
