"""Public names of the packages `design` and `registration`."""

import subprocess
import sys

import pytest

import design
import registration
from design.on_demand import exported_names

QUICK = "import design.files, registration, sys; print('trimesh' in sys.modules)"


@pytest.mark.parametrize("package", [design, registration])
def test_a_package_hands_on_what_it_names(package):
    assert sorted(exported_names(package.__name__)) == sorted(package.__all__)


def test_a_room_is_not_loaded_before_it_is_asked_for():
    done = subprocess.run([sys.executable, "-c", QUICK], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
