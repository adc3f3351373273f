"""Recipe section on datums."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from printctl.recipe.making import RegistrationPart


def test_a_recipe_names_its_datums_and_slips_are_refused() -> None:
    part = RegistrationPart.model_validate({"datums": ["face -z", "axis 3"]})
    assert part.datums == ["face -z", "axis 3"]
    assert RegistrationPart().datums == []
    with pytest.raises(ValidationError, match="'face up' isn't known; give a face"):
        RegistrationPart.model_validate({"datums": ["face up"]})
