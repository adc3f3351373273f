"""Path of the commented template recipe that `printctl init` writes."""

from pathlib import Path
from typing import Final

STARTER: Final = Path(__file__).parent / "starter.yaml"
"""Runs as it stands, on the simulated printer."""
