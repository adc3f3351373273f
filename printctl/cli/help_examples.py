"""Append usage examples and exit codes to the help of each command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from rich.table import Table
from rich.text import Text
from typer import rich_utils

ALWAYS: Final[Mapping[int, str]] = {0: "done", 1: "failed", 2: "wrong use"}
REFUSED: Final[Mapping[int, str]] = {3: "a safety check refused it"}
PRINTS: Final[Mapping[int, str]] = {**REFUSED, 4: "the printer failed, or was stopped"}
REACHES: Final[Mapping[int, str]] = {4: "the link to the printer failed"}
PASSES: Final[Mapping[int, str]] = {1: "failed, or the print doesn't pass"}


@dataclass(frozen=True)
class Manual:
    """Of one command: lines as they would be typed, and exit codes beside `ALWAYS`."""

    examples: tuple[str, ...]
    codes: Mapping[int, str] = field(default_factory=dict)

    def epilog(self) -> str:
        """The end of the command's help, as Markdown."""
        codes = "; ".join(f"{code} {meaning}" for code, meaning in self.exit_codes().items())
        lines = "\n".join(self.examples)
        return f"Examples\n\n```text\n{lines}\n```\n\nExit codes: {codes}."

    def exit_codes(self) -> dict[int, str]:
        """All of them, in order."""
        return dict(sorted({**ALWAYS, **self.codes}.items()))


MANUAL: Final[Mapping[str, Manual]] = {
    "run": Manual(
        ("printctl run recipe.yaml", "printctl run recipe.yaml --out runs/second --pdf"),
        {**PRINTS, **PASSES},
    ),
    "design": Manual(("printctl design recipe.yaml --out design",)),
    "toolpath": Manual(("printctl toolpath recipe.yaml --out part.gcode",), REFUSED),
    "slice": Manual(("printctl slice part.stl --unit mm --out part.gcode --layer-um 60",)),
    "simulate": Manual(
        (
            "printctl simulate part.gcode --printer generic_marlin",
            "printctl simulate part.gcode --ink collagen_fresh --needle fresh_150um --out seen",
        ),
        REFUSED,
    ),
    "print": Manual(
        (
            "printctl print part.gcode --printer generic_marlin --port simulated",
            "printctl print part.gcode --printer mine.yaml --port auto --deadman 20",
        ),
        PRINTS,
    ),
    "status": Manual(("printctl status runs/my_run",)),
    "stop": Manual(("printctl stop runs/my_run",), REACHES),
    "kill": Manual(("printctl kill runs/my_run",), REACHES),
    "pause": Manual(("printctl pause runs/my_run --after layer",), REACHES),
    "resume": Manual(("printctl resume runs/my_run",), REACHES),
    "reload": Manual(("printctl reload runs/my_run",), REACHES),
    "alive": Manual(("printctl alive runs/my_run",), REACHES),
    "recover": Manual(("printctl recover runs/my_run",), REACHES),
    "give-up": Manual(("printctl give-up runs/my_run",), REACHES),
    "sim-printer": Manual(("printctl sim-printer --link /tmp/printer",)),
    "scan": Manual(
        (
            "printctl scan part.gcode.print --out scan.tif",
            "printctl scan 1795267901 --device microct --voxel-um 40,40,40",
        )
    ),
    "register": Manual(
        (
            "printctl register scan.tif --model runs/my_run --out report",
            "printctl register scan.tif --model part.stl --network network.csv --out report "
            "--voxel-um 15,15,12",
        ),
        PASSES,
    ),
    "dye": Manual(
        (
            "printctl dye dye.mp4 --model runs/my_run --marks marks.yaml --out dye "
            "--flow-ml-min 0.25",
            "printctl dye --predict --model runs/my_run --out dye --frames-per-s 25",
        ),
        {1: "failed, or the part doesn't pass"},
    ),
    "overlay": Manual(("printctl overlay scan.tif --model runs/my_run --out overlay",)),
    "compare": Manual(("printctl compare runs/a runs/b runs/c --out several",)),
    "compensate": Manual(("printctl compensate runs/first runs/second --out made.yaml",)),
    "view": Manual(
        (
            "printctl view runs/my_run",
            "printctl view runs/my_run --png figure.png --colour pressure",
            "printctl view part.gcode --png layer.png --layer 26",
        )
    ),
    "film": Manual(
        (
            "printctl film runs/my_run",
            "printctl film runs/my_run --by generations --out growth.gif",
            "printctl film runs/my_run --show pulse --colour pressure",
        )
    ),
    "convert": Manual(("printctl convert network.csv tree.swc --unit mm",)),
    "solid": Manual(("printctl solid network.csv --unit mm --out lumen.stl",)),
    "measure": Manual(("printctl measure tree.csv --unit mm --tissue t.stl --tissue-unit mm",)),
    "search": Manual(
        ("printctl search search.yaml --out found",),
        {1: "failed, a candidate broke, or none keeps the limits"},
    ),
    "flow": Manual(
        (
            "printctl flow tree.csv --unit mm --out flow",
            "printctl flow tree.csv --unit mm --amplitude-ml-min 0.1 --period-s 1 "
            "--wall-young-kpa 10 --one-d",
            "printctl flow runs/my_run --as-printed",
        )
    ),
    "oxygen": Manual(("printctl oxygen runs/my_run --cells-per-ml 2e7 --out oxygen",)),
    "lumens": Manual(
        (
            "printctl lumens part.gcode --network runs/my_run --syringe hamilton_1ml",
            "printctl lumens part.gcode --model part.stl --unit mm --filament-mm 1.75",
        ),
        {3: "a lumen is closed or leaks"},
    ),
    "ports": Manual(("printctl ports", "printctl ports --find"), REACHES),
    "profiles": Manual(("printctl profiles", "printctl profiles check mine.yaml")),
    "profiles show": Manual(
        ("printctl profiles show", "printctl profiles show generic_marlin --write mine.yaml")
    ),
    "profiles check": Manual(
        ("printctl profiles check mine.yaml",), {1: "it mustn't be used as it is"}
    ),
    "profiles probe": Manual(
        ("printctl profiles probe --port /dev/ttyACM0 --profile mine.yaml",),
        {1: "failed, or something differs", **REACHES},
    ),
    "history": Manual(("printctl history", "printctl history --search heart --csv")),
    "history show": Manual(("printctl history show 1795267901",)),
    "history bundle": Manual(("printctl history bundle 1795267901 --out heart_3.zip",)),
    "history verify": Manual(("printctl history verify heart_3.zip --key lab.pem",)),
    "history key": Manual(("printctl history key --out lab.pem",)),
    "history repeat": Manual(("printctl history repeat 1795267901 --to work/jobs",)),
    "history list": Manual(("printctl history list --state killed --since 2026-11-01",)),
    "history csv": Manual(("printctl history csv --since 2026-11-01",)),
    "history rebuild": Manual(("printctl history rebuild",)),
    "calibrate": Manual(("printctl calibrate weigh weigh.csv --write mine.yaml",)),
    "calibrate weigh": Manual(
        (
            "printctl calibrate weigh --gcode weigh.gcode",
            "printctl calibrate weigh weigh.csv --write mine.yaml",
        )
    ),
    "calibrate offset": Manual(
        (
            "printctl calibrate offset touched.csv",
            "printctl calibrate offset touched.csv --printer two_syringe_marlin --head 1 "
            "--write mine.yaml",
        )
    ),
    "calibrate level": Manual(("printctl calibrate level touched.csv",)),
    "calibrate backlash": Manual(("printctl calibrate backlash x.csv",)),
    "calibrate lag": Manual(("printctl calibrate lag widths.csv",)),
    "calibrate pattern": Manual(
        (
            "printctl calibrate pattern lines --profile mine.yaml --ink collagen_fresh "
            "--needle 25g --bath gelatin_support -o lines.gcode",
        )
    ),
    "calibrate widths": Manual(
        ("printctl calibrate widths seen.png --pattern lines.json --write my_ink.yaml",)
    ),
    "calibrate board": Manual(("printctl calibrate board board.png --square-mm 2 --dpi 1200",)),
    "calibrate camera": Manual(
        ("printctl calibrate camera board_seen.png --square-mm 2.003 --write camera.yaml",)
    ),
    "calibrate oct": Manual(
        (
            "printctl calibrate oct --grid low.oct --grid high.oct --pitch-um 500",
            "printctl calibrate oct --reference r1 --reference r2 --write device.yaml",
        )
    ),
    "calibrate walls": Manual(("printctl calibrate walls r1 r2 r3 --write device.yaml",)),
    "observe": Manual(("printctl observe insert --dish petri_60mm --out insert",)),
    "observe insert": Manual(
        (
            "printctl observe insert --dish petri_60mm --out insert",
            "printctl observe insert --dish mine.yaml --hole-mm 55 --made paper --out insert",
        )
    ),
    "observe frame": Manual(
        (
            "printctl observe frame seen.png --lens camera.yaml --insert insert/insert.yaml "
            "--touched left=66.7,100.1,4.2 --touched right=133.3,99.9,4.2 -o frame.yaml",
            "printctl observe frame seen.png --lens camera.yaml --insert insert/insert.yaml "
            "--printed squares.json --at 100,100,4.2 -o frame.yaml",
        )
    ),
    "observe check": Manual(("printctl observe check now.png --frame frame.yaml",), REFUSED),
    "observe sweep": Manual(
        ("printctl observe sweep flat/ --frame frame.yaml --floor-z 1.2 -o laser.yaml",)
    ),
    "observe looks": Manual(("printctl observe looks runs/my_run",)),
    "observe answer": Manual(
        (
            "printctl observe answer runs/my_run approve --look 3",
            "printctl observe answer runs/my_run go_on",
        )
    ),
    "observe tip": Manual(
        (
            "printctl observe tip a.png b.png --at 85,95,12 --at 115,105,12 --needle 25g "
            "--frame frame.yaml",
        )
    ),
    "doctor": Manual(
        ("printctl doctor", "printctl doctor --json", "printctl doctor --warm"),
        {1: "something keeps printctl from working here"},
    ),
    "serve": Manual(
        (
            "printctl serve",
            "printctl serve work --port 8081",
            "printctl serve work --host 0.0.0.0 --password",
        )
    ),
    "station": Manual(("printctl station connect --printer mine.yaml --port auto",), REACHES),
    "station connect": Manual(
        (
            "printctl station connect --printer mine.yaml --port /dev/ttyACM0",
            "printctl station connect --printer generic_marlin --port simulated",
        ),
        REACHES,
    ),
    "station status": Manual(("printctl station status --json",)),
    "station mount": Manual(
        ("printctl station mount --needle 25g --syringe bd_1ml --dish petri_60mm",), REACHES
    ),
    "station jog": Manual(
        ("printctl station jog --z 1", "printctl station jog --x 100 --y 100 --to"), REACHES
    ),
    "station home": Manual(("printctl station home xy --needle-off",), REACHES),
    "station where": Manual(("printctl station where --x 100 --y 100 --z 30",), REACHES),
    "station touch-off": Manual(("printctl station touch-off --foil 0.05",), REACHES),
    "station push": Manual(("printctl station push --ul 2",), REACHES),
    "station heat": Manual(("printctl station heat bed 24",), REACHES),
    "station send": Manual(("printctl station send M503",), REACHES),
    "station stop": Manual(("printctl station stop",), REACHES),
    "station kill": Manual(("printctl station kill",), REACHES),
    "station reconnect": Manual(("printctl station reconnect",), REACHES),
    "station disconnect": Manual(("printctl station disconnect",), REACHES),
    "init": Manual(("printctl init my_print.yaml",)),
    "recipe": Manual(("printctl recipe migrate old.yaml",)),
    "recipe schema": Manual(("printctl recipe schema",)),
    "recipe migrate": Manual(
        (
            "printctl recipe migrate old.yaml",
            "printctl recipe migrate old.yaml --out new.yaml",
        )
    ),
}
"""By the words that follow `printctl`."""


def with_manual(command: Any, name: str) -> Any:
    """Give a command, and those in it, the end of its help; what has no manual stays as it is."""
    if name in MANUAL:
        command.epilog = MANUAL[name].epilog()
        command.rich_markup_mode = "markdown"
    for word, inner in getattr(command, "commands", {}).items():
        with_manual(inner, f"{name} {word}")
    return command


# Help tables in which option names stay whole; imported when help is asked for.
#
# Typer's tables have a column each for long, short and negative names, and cut them with an
# ellipsis where the terminal is narrow.

_REQUIRED: Final = "*"


class NameTable(Table):
    """Rich's table, but for one of options: names in one column, which isn't cut."""

    _of_options = False

    def add_row(self, *cells: Any, **named: Any) -> None:
        """Add a row; of an option it is its marks and names, its type, its description."""
        # Tables of commands say their columns first.
        if not self.columns:
            self._of_options = True
            self.add_column(no_wrap=True)
        if self._of_options:
            *names, kind, description = cells
            cells = (_joined(names), kind, description)
        super().add_row(*cells, **named)


def _joined(cells: list[Any]) -> Text:
    """Names below each other, after the mark of what must be given."""
    texts = [cell if isinstance(cell, Text) else Text(str(cell)) for cell in cells]
    said = [text for text in texts if text.plain]
    mark = said.pop(0) if said and said[0].plain == _REQUIRED else None
    names = Text("\n").join(said)
    return names if mark is None else Text(" ").join([mark, names])


def use_name_tables() -> None:
    """Have typer write its help by `NameTable`."""
    # Typer offers no way in: its module looks the class up by this name.
    setattr(rich_utils, "Table", NameTable)  # noqa: B010
