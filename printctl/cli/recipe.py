"""`printctl recipe` and `init`: write, check and migrate recipes."""

from __future__ import annotations

from pathlib import Path

import typer

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from printctl.cli.declare import command
from printctl.cli.options import RecipeArg, print_json, print_lines, print_note
from printctl.errors import UsageError
from printctl.recipe import SCHEMA, Recipe, parse_recipe
from printctl.recipe.load import STARTER, Step, migrated_text, read_mapping, steps_from
from printctl.settings import arg, opt

recipe = typer.Typer(help="The recipe's schema, and recipes of an older one.")


@recipe.command()
def schema() -> None:
    """Print the recipe's JSON Schema: every key with its type, bounds, default and meaning.

    An editor that knows YAML completes and checks a recipe by it, when the recipe's first line is
    `# yaml-language-server: $schema=recipe.schema.json`.
    """
    print_json(Recipe.model_json_schema(by_alias=True))


@recipe.command()
@command
def migrate(
    file: RecipeArg,
    out: Path | None = opt("Where to write; the recipe's own file by default."),
) -> None:
    """Bring a recipe to today's schema; comments and order stay, the old file is kept beside it.

    Nothing is written unless the result is a recipe that can be used.
    """
    data = read_mapping(file, "recipe", "`printctl init` writes a starter")
    steps = steps_from(data, str(file))
    if not steps:
        parse_recipe(data, str(file))
        print_lines(f"{file} is of schema {SCHEMA}, today's; nothing to do")
        return
    text = file.read_text(encoding="utf-8")
    made = migrated_text(text, steps)
    parse_recipe(read_yaml(made), f"{file}, once migrated,")
    if out is None:
        kept = _backup(file, data["schema"])
        write_text(kept, text)
        print_note(f"the recipe as it was: {kept}")
    elif out.exists():
        raise UsageError(f"{out} exists and isn't overwritten; give another name")
    write_text(out or file, made)
    print_lines(*_step_lines(steps), str(out or file))


def _backup(file: Path, schema: int) -> Path:
    """Where the old text is kept; never over a file that is there."""
    kept = file.with_name(f"{file.stem}.schema{schema}{file.suffix}")
    if kept.exists():
        raise UsageError(
            f"{kept}, where the old recipe is kept, exists; move it away, or use --out"
        )
    return kept


def _step_lines(steps: tuple[Step, ...]) -> list[str]:
    return [f"schema {step.old} to {step.old + 1}: {step.why}" for step in steps]


@command
def init(
    path: Path = arg("Where to write the recipe.", Path("recipe.yaml")),
) -> None:
    """Write a commented starter recipe that runs as it stands.

    It prints on the simulated printer. A file that is there isn't overwritten.
    """
    if path.exists():
        raise UsageError(f"{path} exists and isn't overwritten; give another name")
    write_text(path, STARTER.read_text(encoding="utf-8"))
    print_lines(f"{path}", f"next: printctl run {path}")
