"""`printctl compare`, `compensate`: several prints of one design; what the next one corrects."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from printctl.cli.declare import json_command
from printctl.cli.options import OutFolder, PdfFlag, print_notes, print_result
from printctl.corrections import compensation
from printctl.corrections.feedback import Choices, Mean, estimate, read_print
from printctl.errors import UsageError
from printctl.history.comparing import NewLimits, PrintNames, read_folders, write_comparison
from printctl.settings import arg, of, opt
from registration.comparison import compare, verdict


@json_command
def compare_prints(
    *,
    folders: list[Path] = arg(
        "Run folders, or folders that `printctl register` wrote; two or more.", metavar="RUN..."
    ),
    out: OutFolder,
    prints: str | None = opt(
        "Which print each folder's scan is of, by any names; else by its journal.",
        metavar="A,A,B,...",
    ),
    repeatability: bool = opt(
        "Gauge R&R: the folders are operators x parts x repeats (ANOVA, AIAG MSA).", False
    ),
    operators: str | None = opt(
        "With --repeatability: who made each folder's scan; else as its record says.",
        metavar="A,A,B,...",
    ),
    parts: str | None = opt(
        "With --repeatability: the part each folder's scan is of; else as its record or journal "
        "says.",
        metavar="1,2,1,...",
    ),
    tolerance_um: float | None = opt("Judge all prints anew by this RMS limit.", min=0.1),
    diameter_tolerance_percent: float | None = opt(
        "Judge all prints anew by this limit, and tell the capability (Cp, Cpk).", min=0.1
    ),
    pdf: PdfFlag = False,
) -> None:
    """Hold several prints of one design against each other: what repeats, varies, drifts.

    Exit code 0 whatever the verdicts are; 1 when the registrations can't be compared.
    """
    if not repeatability and (operators or parts):
        raise UsageError("--operators and --parts describe a gauge study; add --repeatability")
    given = ((prints, "--prints"), (operators, "--operators"), (parts, "--parts"))
    named = PrintNames(*(_names(text, option, len(folders)) for text, option in given))
    anew = None
    if tolerance_um is not None or diameter_tolerance_percent is not None:
        anew = NewLimits(tolerance_um or 100.0, diameter_tolerance_percent or 10.0)
    scans = read_folders(folders, named, anew)
    found = compare(scans, diameter_tolerance_percent, repeatability)
    title = " to ".join(folders[end].resolve().name for end in (0, -1))
    data, pages = write_comparison(out, found, title, anew, pdf=pdf)
    print_result(data, [*verdict(found)["reasons"], *data["notes"], *map(str, pages)])


def _names(text: str | None, option: str, count: int) -> list[str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != count or not all(names):
        raise UsageError(
            f"{option} {text!r} names {len(names)} {option[2:]} for {count} folders; give one name "
            "for each folder, in their order, like A,A,B"
        )
    return names


@json_command
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
    gain: float = of(compensation.GainPart, "whole", "--gain", max=None),
    local_gain: float = of(compensation.GainPart, "local", "--local-gain", max=None),
    without_vessel: list[int] | None = opt("A vessel to leave out; may be repeated."),
    whole_only: bool = opt("Nothing for single vessels and nodes.", False),
) -> None:
    """Make a compensation from registered prints, for a recipe's `toolpath.compensation`.

    What isn't told from chance isn't corrected. Beyond 10 % of size, 20 % or 150 µm of a diameter,
    or 150 µm of place nothing is.
    """
    compensation.check_suffix(out)
    if depth_standard is not None and not depth_standard.strip():
        raise UsageError("--depth-standard is empty; say what it is, e.g. 'step of 1.00 mm in gel'")
    try:
        gains = compensation.GainPart(whole=gain, local=local_gain)
    except ValidationError as exc:
        raise UsageError(
            f"--gain {gain:g} and --local-gain {local_gain:g} must lie above 0 and be at most 1: "
            "more than what was measured is never corrected"
        ) from exc
    bias = None if diameter_bias_um is None else _bias(diameter_bias_um)
    without = frozenset(without_vessel or ())
    choices = Choices(gains, depth_standard, bias, without, local=not whole_only)
    read = [read_print(folder) for folder in prints]
    count = read[0].network.vessel_count
    if wrong := sorted(vessel for vessel in without if not 0 <= vessel < count):
        raise UsageError(f"--without-vessel {wrong[0]}: the network has vessels 0 to {count - 1}")
    made = estimate(read, choices)
    compensation.save_compensation(out, made)
    print_notes(made.notes)
    facts = made.model_dump(mode="json", by_alias=True)
    lines = [
        *compensation.evidence_lines(made),
        f"written instead: {compensation.changes_line(made)}",
        str(out),
    ]
    print_result(facts, lines)


def _bias(text: str) -> Mean:
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
