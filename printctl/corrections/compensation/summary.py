"""Summarise a compensation's corrections in one line of text."""

from __future__ import annotations

from printctl.corrections.compensation.schema import CompensationFile


def changes_line(made: CompensationFile) -> str:
    """For the report and the command line: sizes, lumens, axes; what is left alone is said too."""
    x, y, z = made.stretch.factor
    parts = [f"x × {x:.4f}, y × {y:.4f}"]
    parts.append(f"z × {z:.4f}" if z != 1 else "depth as designed")
    parts.append(_radial(made))
    if made.vessels:
        worst = max((part.diameter_um for part in made.vessels), key=abs)
        parts.append(f"{_count(len(made.vessels), 'vessel')} by up to {worst:+.0f} µm in diameter")
    if made.nodes:
        most = max(sum(v * v for v in part.offset_um) ** 0.5 for part in made.nodes)
        parts.append(f"{_count(len(made.nodes), 'node')} moved by up to {most:.0f} µm")
    return "; ".join(parts).replace("-", "\N{MINUS SIGN}")


def _radial(made: CompensationFile) -> str:
    radial = made.radial
    if not radial.offset_um and not radial.slope_um_per_mm:
        return "no radial offset"
    text = f"lumens' radius {radial.offset_um:+.1f} µm"
    if radial.slope_um_per_mm:
        text += f" at {radial.at_mm:.2f} mm, {radial.slope_um_per_mm:+.1f} µm per mm of diameter"
    return text


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
