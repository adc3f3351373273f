"""The tissue that most trees of these tests grow in."""

import pytest

from design.tissue import block
from tests.design.tissue.kept import kept_tissue


@pytest.fixture(scope="session")
def box():
    return kept_tissue(block((20.0, 16.0, 12.0)))
