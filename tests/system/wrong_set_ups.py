"""A small sound print of own profiles, and the ways in which its set-up can be wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from firmware_profiles.load import FOLDERS, shipped_text
from printctl.checks.made_for import PARTS, header_lines, made_for
from printctl.checks.set_up import HeadLoading
from tests.printctl.machine.link.fake_marlin import FakeMarlin

SHIPPED: Final = {
    **{"printer": "generic_marlin", "syringe": "hamilton_1ml", "needle": "30g_50mm"},
    **{"ink": "collagen_fresh", "bath": "gelatin_support", "dish": "box_80mm"},
}
FILL_UL: Final = 500.0
EXTRUDES: Final = re.compile(r"G0*[0-3]\b.*E")


def lines() -> list[str]:
    """Forty strokes at Z 5 around X 100, Y 100, and a lift."""
    opening = ["G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z5 E0"]
    strokes = [
        f"G1 X{100 + 5 * (k % 2)} Y{100 + 0.2 * k:.2f} E{0.05 * k:.4f} F600" for k in range(1, 41)
    ]
    return [*opening, *strokes, "G0 Z70 F300"]


@dataclass
class SetUpOnTest:
    """Profiles, G-code and what is on the machine; a fault changes one of them.

    ``mounted`` and ``named`` are names of profiles by part; ``lengths`` are what else is mounted,
    by the names of `MountedParts`.
    """

    folder: Path
    fake: FakeMarlin
    names: dict[str, str] = field(default_factory=dict)
    mounted: dict[str, str] = field(default_factory=dict)
    named: dict[str, str] = field(default_factory=dict)
    lengths: dict[str, Any] = field(default_factory=dict)
    fill_ul: float = FILL_UL
    text: list[str] = field(default_factory=lines)
    recorded: bool = True

    def __post_init__(self) -> None:
        for part, name in SHIPPED.items():
            text = yaml.safe_load(shipped_text(PARTS[part], name))
            path = self.folder / "profiles" / FOLDERS[PARTS[part]] / f"own_{part}.yaml"
            path.parent.mkdir(parents=True, exist_ok=True)
            if part == "printer":
                text["resets_on_connect"] = False
            path.write_text(yaml.safe_dump(text))
            self.names[part] = str(path)
        self.mounted = {part: name for part, name in self.names.items() if part != "printer"}
        steps = load(Printer, self.names["printer"]).steps_per_mm
        self.fake.steps = f"  M92 X{steps.x:g} Y{steps.y:g} Z{steps.z:g} E{steps.e:g}"
        self.lengths = {"dish_centre_mm": (100.0, 100.0), "bath_depth_mm": 8.0}
        self.record()

    def record(self) -> None:
        """Make the job for the profiles as they are now."""
        load_of = HeadLoading(
            load(Syringe, self.names["syringe"]),
            load(Ink, self.names["ink"]),
            load(Needle, self.names["needle"]),
        )
        made = made_for(
            load(Printer, self.names["printer"]),
            [load_of],
            load(Bath, self.names["bath"]),
            load(Dish, self.names["dish"]),
        )
        self.header = [f"; {line}" for line in header_lines(made)]

    def edit(self, part: str, **values: Any) -> None:
        """Change values of a profile; ``a__b`` is b in a."""
        path = Path(self.names[part])
        data = yaml.safe_load(path.read_text())
        for name, value in values.items():
            outer, _, inner = name.partition("__")
            if inner:
                data[outer][inner] = value
            else:
                data[outer] = value
        path.write_text(yaml.safe_dump(data))

    def save(self) -> Path:
        """Write the job."""
        path = self.folder / "job.gcode"
        path.write_text("\n".join([*(self.header if self.recorded else ()), *self.text]) + "\n")
        return path

    def mount_words(self) -> list[str]:
        """Command that enters what is on the machine."""
        words = ["mount", "--printer", self.names["printer"], *self.part_words(self.mounted)]
        if "syringe" in self.mounted:
            words += ["--fill-ul", f"{self.fill_ul:g}"]
        return words + self.place_words()

    def place_words(self) -> list[str]:
        """Options that say where the dish stands and how high it is filled."""
        if "dish" not in self.mounted:
            return []
        x, y = self.lengths["dish_centre_mm"]
        depth = self.lengths["bath_depth_mm"]
        return ["--bath-depth", f"{depth:g}", "--dish-centre", f"{x:g},{y:g}"]

    @staticmethod
    def part_words(parts: dict[str, str]) -> list[str]:
        """Options that name parts."""
        return [word for part, name in parts.items() for word in (f"--{part}", name)]

    @property
    def extruded(self) -> list[str]:
        """Lines with which the printer was made to push ink."""
        return [line for line in self.fake.executed if EXTRUDES.match(line)]

    @property
    def used_mm(self) -> float:
        """Plunger travel that is used up."""
        facts = load(Syringe, self.mounted["syringe"])
        return (facts.volume_ul - self.fill_ul) * 4 / (math.pi * facts.inner_mm**2)


Fault = Callable[[SetUpOnTest], None]


def other(part: str, name: str) -> Fault:
    """Another part is on the machine than the job was made for."""

    def work(one: SetUpOnTest) -> None:
        one.mounted[part] = name

    return work


def contradicted(part: str, name: str) -> Fault:
    """Another part is named than is on the machine."""

    def work(one: SetUpOnTest) -> None:
        one.named[part] = name

    return work


def edited(part: str, **values: Any) -> Fault:
    """A profile was edited after the job was made."""

    def work(one: SetUpOnTest) -> None:
        one.edit(part, **values)

    return work


def made_so(part: str, **values: Any) -> Fault:
    """The job was made for a profile that doesn't suit it."""

    def work(one: SetUpOnTest) -> None:
        one.edit(part, **values)
        one.record()

    return work


def rewritten(change: Callable[[str], str]) -> Fault:
    """Each line of the job is another."""

    def work(one: SetUpOnTest) -> None:
        one.text = [change(line) for line in one.text]

    return work


def scaled(words: str, factor: float) -> Fault:
    """Words of the job are in another unit."""

    def change(line: str) -> str:
        return re.sub(
            rf"\b([{words}])(-?[\d.]+)", lambda m: f"{m[1]}{float(m[2]) * factor:g}", line
        )

    return rewritten(change)


def inserted(line: str, at: int = 5) -> Fault:
    """The job has one more line."""

    def work(one: SetUpOnTest) -> None:
        one.text.insert(at, line)

    return work


def without_record(*opening: str) -> Fault:
    """The job doesn't record its set-up."""

    def work(one: SetUpOnTest) -> None:
        one.recorded, one.text = False, [*opening, *one.text]

    return work


def mounted_so(**lengths: Any) -> Fault:
    """Something stands or is filled otherwise."""

    def work(one: SetUpOnTest) -> None:
        one.lengths |= lengths

    return work


def filled(ul: float) -> Fault:
    """The syringe holds so much."""

    def work(one: SetUpOnTest) -> None:
        one.fill_ul = ul

    return work


def unknown(part: str) -> Fault:
    """Nobody said which part is there."""

    def work(one: SetUpOnTest) -> None:
        del one.mounted[part]

    return work


def cut(count: int) -> Fault:
    """The job ends after so many lines."""

    def work(one: SetUpOnTest) -> None:
        one.text = one.text[:count]

    return work


def of_firmware(**facts: Any) -> Fault:
    """Another machine answers at the port."""

    def work(one: SetUpOnTest) -> None:
        for name, value in facts.items():
            setattr(one.fake, name, value)

    return work


FAULTS: Final[dict[str, Fault]] = {
    "other syringe": other("syringe", "hamilton_5ml"),
    "syringe of the same volume": other("syringe", "bd_1ml"),
    "wider needle": other("needle", "25g"),
    "same needle, but shorter": other("needle", "30g"),
    "other ink": other("ink", "gelatin_sacrificial"),
    "other bath": other("bath", "carbopol"),
    "other dish": other("dish", "petri_60mm"),
    "syringe contradicts": contradicted("syringe", "hamilton_5ml"),
    "needle contradicts": contradicted("needle", "25g"),
    "ink contradicts": contradicted("ink", "alginate_fresh"),
    "bath contradicts": contradicted("bath", "cell_matrix"),
    "dish contradicts": contradicted("dish", "petri_100mm"),
    "printer edited": edited("printer", steps_per_mm__e=800.0),
    "syringe edited": edited("syringe", inner_mm=4.2),
    "needle edited": edited("needle", inner_mm=0.2),
    "ink edited": edited("ink", flow_factor=1.3),
    "bath edited": edited("bath", yield_stress_pa=20.0),
    "dish edited": edited("dish", wall_mm=40.0),
    "file without a record": without_record(),
    "file of a slicer": without_record("; generated by PrusaSlicer 2.7.1", "; layer_height = 0.2"),
    "job in inches": inserted("G20"),
    "job scaled to inches": scaled("XYZ", 1 / 25.4),
    "job in metres": scaled("XYZ", 1e-3),
    "job in micrometres": scaled("XYZ", 1e3),
    "ink in µL": scaled("E", 16.7),
    "absolute ink read as relative": inserted("M83"),
    "absolute places read as relative": inserted("G91"),
    "job cut off": cut(20),
    "job without its lift": cut(45),
    "needle would go into the floor": inserted("G1 Z-3 F300"),
    "too fast": inserted("G1 X103 Y100 E0.01 F60000"),
    "too hot for the ink": inserted("M104 S90"),
    "too hot for the bath": inserted("M140 S60"),
    "second extruder": inserted("T1"),
    "nearly empty syringe": filled(30),
    "needle shorter than the bath is deep": made_so("needle", length_mm=2),
    "dish too narrow": made_so("dish", inner_x_mm=9, inner_y_mm=9),
    "dish too low for the bath": made_so("dish", wall_mm=8.001),
    "needle too thin for the force": made_so("needle", inner_mm=0.04),
    "bath too warm": made_so("bath", melt_out_c=2.0),
    "bath too shallow": mounted_so(bath_depth_mm=3.0),
    "dish elsewhere": mounted_so(dish_centre_mm=(50.0, 100.0)),
    "syringe unknown": unknown("syringe"),
    "ink unknown": unknown("ink"),
    "needle unknown": unknown("needle"),
    "bath unknown": unknown("bath"),
    "dish unknown": unknown("dish"),
    "other steps in the firmware": of_firmware(steps="  M92 X80.00 Y80.00 Z400.00 E93.00"),
    "other firmware": of_firmware(firmware="Repetier_1.0.4"),
}

OF_THE_MACHINE: Final = {
    *("file without a record", "file of a slicer", "nearly empty syringe"),
    *(f"{part} unknown" for part in ("syringe", "ink", "needle", "bath", "dish")),
    *("other steps in the firmware", "other firmware"),
}
"""Faults that a simulation can't know."""


def in_recipe(section: str, **values: Any) -> Callable[[dict[str, Any]], None]:
    """The recipe says something else; None for nothing."""

    def work(recipe: dict[str, Any]) -> None:
        merged = {**recipe[section], **values}
        recipe[section] = {name: value for name, value in merged.items() if value is not None}

    return work


RECIPE_FAULTS: Final = {
    "another syringe": in_recipe("printer", syringe="hamilton_5ml"),
    "another needle": in_recipe("toolpath", needle="25g"),
    "another dish": in_recipe("printer", dish="petri_60mm"),
    "an ink that doesn't set": in_recipe("printer", ink="alginate_fresh"),
    "an ink that is washed out": in_recipe("printer", ink="gelatin_sacrificial"),
    "a bath that doesn't set the ink": in_recipe("printer", bath="gelatin_calcium"),
    "a bath that stays": in_recipe("printer", bath="carbopol"),
    "no dish": in_recipe("printer", dish=None, bath_depth_mm=None),
    "a dish elsewhere": in_recipe("printer", dish_centre_mm=[20, 20]),
    "a shallow bath": in_recipe("printer", bath_depth_mm=2),
    "a bath over the hub": in_recipe("printer", bath_depth_mm=45),
}
"""Against what `MACHINE_FAULTS` finds on the machine."""
MACHINE_FAULTS: Final = (
    *("other syringe", "other ink", "other bath", "other dish", "nearly empty syringe"),
    *("dish too low for the bath", "bath too warm", "other steps in the firmware"),
)
PLATE_FAULTS: Final = {
    "other needle": ({"needle": "25g"}, None),
    "other ink": ({"ink": "collagen_fresh"}, None),
    "other bath": ({"bath": "gelatin_support"}, None),
    "other syringe": ({"syringe": "bd_1ml"}, None),
    "a dish in the plate's place": ({"dish": "petri_60mm"}, None),
    "bath neither named nor mounted": ({"bath": "none"}, in_recipe("printer", bath=None)),
    "needle too short": ({"needle": "30g"}, in_recipe("toolpath", needle="30g")),
    "bath above the wells": ({}, in_recipe("plate", bath_depth_mm=30)),
    "wells too narrow": ({}, in_recipe("plate", profile="corning_96")),
    "ink that stays": ({"ink": "collagen_fresh"}, in_recipe("printer", ink="collagen_fresh")),
}
"""What is mounted instead, and what the recipe says instead."""
