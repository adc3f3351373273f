"""`printctl run`, `design`, `toolpath`: work off a recipe; `init`, `recipe`: write, migrate."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import typer

from design.files import atomic_replacement, write_text
from firmware_profiles.yaml_file import read_yaml
from printctl.checks import preflight
from printctl.cli import options as cli
from printctl.cli.declare import command, group, json_command
from printctl.cli.kernels_ready import have_kernels, kernels_for_a_run
from printctl.errors import UsageError
from printctl.machine.records.record import REHEARSAL
from printctl.pipeline.run_options import DESIGN_NAMES, names_until
from printctl.pipeline.running.run import RunOptions, design_recipe, run_recipe, toolpath_recipe
from printctl.progress_file import ProgressFile
from printctl.recipe import SCHEMA, load_recipe, parse_recipe
from printctl.recipe.load import STARTER, migrated_text, read_mapping, steps_from
from printctl.recipe.schema import recipe_schema
from printctl.recipe.sections.growth import Growth
from printctl.run_folder.artefacts import GCODE, HTML, LINE_MAP, PDF, PLATE_PICTURE, PLATE_TABLE
from printctl.settings import arg, opt


def process_lines(dry_run: Mapping[str, Any]) -> list[str]:
    """Time against what the ink's cells have, ink against what is loaded, the needle's shaft."""
    changes, fillings = int(dry_run["changes_of_syringe"]), int(dry_run["fillings"])
    timed, shaft = dry_run.get("changes_timed", True), dry_run.get("clearance")
    with_ = f" with {changes} changes of syringe" if changes and timed else ""
    without = f" and {changes} changes of syringe, whose time isn't known" if not timed else ""
    each = "a filling" if fillings == 1 else f"each of {fillings} fillings"
    return [
        f"print time {dry_run['print_time_s'] / 60:.1f} min{with_}{without}; time that the cells "
        f"have: {dry_run['time_the_cells_have']}",
        f"ink {dry_run['ink_needed_ul']:.4g} µL: {dry_run['ink_pushed_ul']:.4g} pushed, "
        f"{dry_run['ink_left_per_filling_ul']:.3g} left behind by {each}; full, it holds "
        f"{dry_run['fillings_hold_ul']:.4g} µL",
        *(preflight.shaft_lines(shaft) if shaft else []),
    ]


@json_command
def run(
    recipe: cli.RecipeArg,
    out: Path | None = opt("Run folder; runs/NAME by default.", callback=cli.folder_to_write),
    until: str | None = opt(
        "Last stage: tissue, vasculature, flow, fidelities, measures, oxygen, solid, toolpath, "
        "dry-run, lumens, print, scan or registration. Nothing is printed before print.",
        metavar="STAGE",
    ),
    printed: bool = opt(
        "Take the print that is done in the run folder; nothing is printed.", False
    ),
    rehearse: float | None = opt(
        "Print on the simulated printer, whatever the recipe names, at so many times real time; 0 "
        "for as fast as it can.",
        metavar="SPEED",
    ),
    progress_file: cli.ProgressFileOption = None,
    host_key: cli.HostKeyOption = None,
    yes: cli.YesFlag = False,
    pdf: cli.PdfFlag = False,
) -> None:
    """Run a recipe from tissue to report; a stage whose inputs are as before isn't done again.

    Exit code 1 when the print doesn't pass, 3 when a safety check refuses it, 4 when the printer
    fails.
    """
    cli.use_host_key(host_key)
    progress = None if progress_file is None else ProgressFile(progress_file)
    with nullcontext() if progress is None else progress.whole(cli.message_of):
        loaded = load_recipe(recipe, cli.print_note)
        suffix = "" if rehearse is None else REHEARSAL
        folder = out if out is not None else Path("runs") / (loaded.name + suffix)
        how = RunOptions(assume_yes=yes, pdf=pdf, until=until, printed=printed, listener=progress,
                         rehearse=rehearse)  # fmt: skip
        # What of the list of kernels the stages need.
        grown = isinstance(loaded.vasculature, Growth)
        designed = until in DESIGN_NAMES
        works = ["design"] if grown or designed else []
        works += [] if designed else [f"run {loaded.toolpath.method}"]
        if loaded.oxygen is not None or loaded.flow.pulse is not None:
            works.append("pulse and oxygen")
        with kernels_for_a_run(*works, listener=progress):
            data = run_recipe(loaded, recipe.resolve().parent, folder, cli.messages(), how)
    passed = until is not None or data["verdict"]["passed"]
    cli.print_result(data, lambda: _ended(data, folder, until, pdf), passed)


def _ended(data: dict[str, Any], folder: Path, until: str | None, pdf: bool) -> list[str]:
    """What is said at the end."""
    # They load what keeps a printer's link; a design needs none of it.
    from printctl.cli.machine.running_print import looks_lines
    from printctl.history.table import HEADLINES, outcome

    process = process_lines(data["dry_run"]) if "dry_run" in data else []
    process += looks_lines(folder)
    if until is not None:
        return [*process, f"done as far as {until}", str(folder)]
    verdict, pdfs = data["verdict"], [folder / PDF] if pdf else []
    if pdf and "plate" in data:
        pdfs = [(folder / row["report"]).parent / PDF for row in data["scanned"]]
    said = [HEADLINES[outcome(verdict)], *verdict["reasons"]]
    return [*process, *said, *map(str, (folder / HTML, *pdfs))]


@json_command
def design(
    recipe: cli.RecipeArg,
    out: cli.OutFolder,
    until: str | None = opt(
        f"Last stage: {', '.join(DESIGN_NAMES[:-1])} or {DESIGN_NAMES[-1]} (default).",
        metavar="STAGE",
    ),
) -> None:
    """Design only: network.csv, network.vtp, lumen.stl, solid.stl, solid.3mf and flow.csv.

    Nothing is sliced or printed. Files that are there are replaced, each by a whole new one. With
    --until the stages after that one aren't run; a later design goes on from there.
    """
    last = DESIGN_NAMES[-1] if until is None else names_until(until)[-1]
    if last not in DESIGN_NAMES:
        raise UsageError(
            f"--until {until}: printctl design ends at {DESIGN_NAMES[-1]}; give one of "
            f"{', '.join(DESIGN_NAMES)}, or use printctl run --until {until}"
        )
    loaded = load_recipe(recipe, cli.print_note)
    have_kernels("design")
    data = design_recipe(loaded, recipe.resolve().parent, out, cli.messages(), last)
    reached = [f"done as far as {last}"] if until else []
    cli.print_result(data, lambda: [*_made(data), *reached, str(out)])


def _made(data: dict[str, Any]) -> Iterator[str]:
    """Say what the stages that were run have made."""
    if network := data.get("network"):
        yield (
            f"{network['vessels']} vessels, {network['diameter_min_mm']:.3g} to "
            f"{network['diameter_max_mm']:.3g} mm, {network['volume_mm3']:.3g} mm³"
        )
    if flow := data.get("flow"):
        yield (
            f"pressure drop {flow['pressure_drop_mmhg']:.3g} mmHg at "
            f"{flow['inlet_flow_ml_min']:.3g} mL/min"
        )


def plan_lines(plan: Mapping[str, Any]) -> Iterator[str]:
    """Name every vessel that isn't written and every open joint, from ``summary.plan``."""
    left, cut = plan.get("left_out", ()), plan.get("cut_off", ())
    if left:
        yield (
            f"{len(left)} vessels aren't written, since the needle would pass through ink in any "
            f"order (toolpath.leave_out); {len(cut)} written ones lose their supply"
            + (f": {', '.join(map(str, cut))}" if cut else "")
        )
    for one in left:
        text = (
            f"vessel {one['vessel']} isn't written: too near to vessel {one['other']} at "
            f"{_place(one)}; they would have to be at least {one['apart_mm']:.3f} mm further apart"
        )
        if one["needle_mm"] > 0:
            text += f", or the needle's tip {one['needle_mm']:.3f} mm wide outside"
        yield text
    for one in plan.get("open", ()):
        if "barred_by" not in one:
            continue
        text = f"joint of vessels {one['vessel']} and {one['other']} at {_place(one)} stays open"
        if one["barred_by"] >= 0:
            text += f": vessel {one['barred_by']} is in the shaft's way on either side"
        if one["needle_mm"] > 0:
            text += (
                f"; a quarter of the overlap has room with that vessel {one['apart_mm']:.3f} mm "
                f"further off sideways, or a tip {one['needle_mm']:.3f} mm wide outside"
            )
        yield text


def _place(one: Mapping[str, Any]) -> str:
    x, y, z = one["place_mm"]
    return f"({x:.2f}, {y:.2f}, {z:.2f}) mm"


@json_command
def toolpath(recipe: cli.RecipeArg, out: Path = opt("G-code file to write.", ...)) -> None:
    """Write a recipe's G-code after its dry run, with FILE.map.npz (line to vessel or layer).

    Of a plate with FILE.wells.csv and a picture, FILE.svg.
    """
    cli.gcode_to_write(out, recipe)
    loaded = load_recipe(recipe, cli.print_note)
    with tempfile.TemporaryDirectory() as scratch:
        data = toolpath_recipe(loaded, recipe.resolve().parent, Path(scratch), cli.messages())
        beside = {LINE_MAP: ".map.npz", GCODE: out.suffix}
        if loaded.plate is not None:
            beside |= {PLATE_TABLE: ".wells.csv", PLATE_PICTURE: ".svg"}
        for name, suffix in beside.items():
            with atomic_replacement(out.with_suffix(suffix)) as draft:
                shutil.copyfile(Path(scratch) / name, draft)
    made, dry_run = data["toolpath"], data["dry_run"]
    lines = [
        f"{made['lines']} lines, {made['written_ul']:.4g} µL, {dry_run['duration_s'] / 60:.1f} min",
        *process_lines(dry_run),
        *plan_lines(made.get("plan", {})),
    ]
    cli.print_result(data, [*lines, str(out)])


def schema() -> None:
    """Print the recipe's JSON Schema: every key with its type, bounds, default and meaning.

    An editor that knows YAML completes and checks a recipe by it, when the recipe's first line is
    `# yaml-language-server: $schema=recipe.schema.json`.
    """
    cli.print_json(recipe_schema())


@command
def migrate(
    file: cli.RecipeArg,
    out: Path | None = opt("File to write; default: the recipe itself."),
) -> None:
    """Bring a recipe to today's schema; comments and order stay, the old file is kept beside it.

    Nothing is written unless the result is a recipe that can be used.
    """
    data = read_mapping(file, "recipe", "`printctl init` writes a starter")
    steps = steps_from(data, str(file))
    if not steps:
        parse_recipe(data, str(file))
        cli.print_lines(f"{file} is of schema {SCHEMA}, today's; nothing to do")
        return
    text = file.read_text(encoding="utf-8")
    made = migrated_text(text, steps)
    parse_recipe(read_yaml(made), f"{file}, once migrated,")
    if out is None:
        kept = file.with_name(f"{file.stem}.schema{data['schema']}{file.suffix}")
        if kept.exists():
            raise UsageError(
                f"{kept}, where the old recipe is kept, exists; move it away, or use --out"
            )
        write_text(kept, text)
        cli.print_note(f"the recipe as it was: {kept}")
    elif out.exists():
        raise UsageError(f"{out} exists and isn't overwritten; give another name")
    write_text(out or file, made)
    cli.print_lines(
        *(f"schema {one.old} to {one.old + 1}: {one.why}" for one in steps), str(out or file)
    )


recipe = group(
    typer.Typer(help="The recipe's schema, and recipes of an older one."), schema, migrate
)


@command
def init(path: Path = arg("File for the recipe.", Path("recipe.yaml"))) -> None:
    """Write a commented starter recipe that runs as it stands.

    It prints on the simulated printer. A file that is there isn't overwritten.
    """
    if path.exists():
        raise UsageError(f"{path} exists and isn't overwritten; give another name")
    write_text(path, STARTER.read_text(encoding="utf-8"))
    cli.print_lines(str(path), f"next: printctl run {path}")
