"""Convert the options of `printctl flow` to a recipe's `flow` section and validate it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import ValidationError

from firmware_profiles.wrong_values import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart

_STEADY: Final = (
    "inlet_flow_ml_min", "inlet_pressure_mmhg", "outlet_pressure_mmhg", "viscosity_mpa_s",
    "density_g_cm3",
)  # fmt: skip
_BEHIND: Final = ("resistance_mmhg_min_ml", "proximal_mmhg_min_ml", "compliance_ml_mmhg")
_WAVES: Final = ("amplitude_ml_min", "amplitude_mmhg", "shape", "waveform")
_FOR_WAVES: Final = ("period_s", "wall_young_kpa", "wall_thickness_mm")
_FOR_ONE_D: Final = ("cell_mm", "wall_viscosity_pa_s")
_FOR_MATCH: Final = ("want", "match_percent", "least_lumen_mm")
_FOR_THREE_D: Final = ("edge_ratio", "order", "check")


def part_of(asked: Mapping[str, Any]) -> FlowPart:
    """The section that options, by their names, stand for.

    Raises
    ------
    UsageError
        For options that don't go together, a value out of bounds, a fluid that can't be read.
    """
    waves = any(asked[key] is not None for key in _WAVES)
    _refuse_idle(asked, waves)
    section: dict[str, Any] = {k: asked[k] for k in _STEADY if asked[k] is not None}
    section |= _outlet(asked) | _fluid(asked["fluid"]) | _losses(asked)
    if asked["shear_band_dyn_cm2"] is not None:
        section["shear_band_dyn_cm2"] = _numbers(
            asked["shear_band_dyn_cm2"], "--shear-band-dyn-cm2", "LOW,HIGH", 2
        )
    if waves:
        section["pulse"] = _pulse(asked)
    if asked["one_d"]:
        given = {key: asked[key] for key in _FOR_ONE_D}
        section["one_d"] = {key: value for key, value in given.items() if value is not None}
    section |= _space(asked)
    try:
        return FlowPart(**section)
    except ValidationError as exc:
        first = exc.errors()[0]
        where = [str(key) for key in first["loc"] if key != "pulse"]
        name = ".".join(where) or ("pulsatile flow" if waves else "flow")
        raise UsageError(f"{name}: {wording(first)}") from exc


def _outlet(asked: Mapping[str, Any]) -> dict[str, Any]:
    behind = {key: asked[f"outlet_{key}"] for key in _BEHIND}
    given = {key: value for key, value in behind.items() if value is not None}
    conditions: dict[str, Any] = {"outlet": given} if given else {}
    if asked["outlets"] is not None:
        if not Path(asked["outlets"]).is_file():
            raise UsageError(
                f"--outlets {asked['outlets']} isn't there, or no file; check the path"
            )
        conditions["outlets"] = str(Path(asked["outlets"]).resolve())
    return conditions


def _space(asked: Mapping[str, Any]) -> dict[str, Any]:
    section: dict[str, Any] = {}
    if asked["three_d"]:
        given = {key: asked[key] for key in _FOR_THREE_D}
        section["three_d"] = {key: value for key, value in given.items() if value is not None}
    if asked["compare"]:
        section["compare"] = {"along_vessel": asked["along_vessel"]}
    return section


def _fluid(path: Any) -> dict[str, Any]:
    if path is None:
        return {}
    try:
        values = read_yaml(Path(path).read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(f"--fluid {path} can't be read: {exc.strerror}; check the path") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise UsageError(f"{path} isn't YAML: {exc}; write model: carreau and its numbers") from exc
    if not isinstance(values, dict):
        raise UsageError(f"{path} names no fluid; write model: carreau and its numbers")
    return {"viscosity": values}


def _losses(asked: Mapping[str, Any]) -> dict[str, Any]:
    stenoses = []
    for text in asked["stenosis"] or ():
        vessel, share, length = _numbers(text, "--stenosis", "VESSEL,SHARE,MM", 3)
        number = int(vessel) if vessel.is_integer() else vessel
        stenoses.append({"vessel": number, "diameter_share": share, "length_mm": length})
    if asked["junction_k"] is None and not stenoses:
        return {}
    return {"losses": {"junction_k": asked["junction_k"] or 0.0, "stenoses": stenoses}}


def _numbers(text: str, option: str, form: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise UsageError(f"{option} {text!r} isn't {form}; write numbers with commas between")
    return numbers


def _pulse(asked: Mapping[str, Any]) -> dict[str, Any]:
    names = ("amplitude_ml_min", "amplitude_mmhg", "shape", *_FOR_WAVES, "profile", "steps")
    table = asked["waveform"]
    if table is not None and not Path(table).is_file():
        raise UsageError(f"--waveform {table} isn't there, or no file; check the path")
    return {
        **{key: asked[key] for key in names},
        "table": None if table is None else str(Path(table).resolve()),
    }


def _refuse_idle(asked: Mapping[str, Any], waves: bool) -> None:
    idle = [key for key in _FOR_WAVES if asked[key] is not None]
    if idle and not waves:
        raise UsageError(
            f"--{idle[0].replace('_', '-')} is for pulsatile flow; give --amplitude-ml-min, "
            "--shape or --waveform"
        )
    for keys, other in (
        (_FOR_ONE_D, "one_d"),
        (_FOR_THREE_D, "three_d"),
        (("along_vessel",), "compare"),
        (("ranks_python",), "ranks"),
        (("slurm_set",), "slurm"),
        (_FOR_MATCH, "match_split"),
    ):
        for key in keys:
            # An option that may be given again is an empty list where it isn't given.
            if asked[key] not in (None, False, [], ()) and not asked[other]:
                name, wants = (x.replace("_", "-") for x in (key, other))
                raise UsageError(f"--{name} is for --{wants}; add that, or leave it out")
    lumens = ("three_d", "match_split", "ranks", "slurm", "svmultiphysics")
    if asked["fillet_ratio"] is not None and not any(asked[key] for key in lumens):
        raise UsageError(
            "--fillet-ratio rounds the lumens that 3D flow is solved in; give --three-d, "
            "--match-split, --ranks, --slurm or --svmultiphysics, or leave it out"
        )
    for key, does in (
        ("svzerod", "writes a pulsatile problem"),
        ("svoned", "writes a pulsatile problem"),
        ("svmultiphysics", "writes a pulsatile problem"),
        ("one_d", "follows a pulse"),
    ):
        if asked[key] and not waves:
            raise UsageError(
                f"--{key.replace('_', '-')} {does}; give --amplitude-ml-min, --shape or --waveform"
            )
