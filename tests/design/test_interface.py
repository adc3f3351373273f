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


@pytest.mark.parametrize("package", [design, registration])
def test_everything_handed_on_says_what_it_is(package):
    for name in package.__all__:
        if name != "LAB":
            assert getattr(package, name).__doc__, name


def test_a_name_that_is_not_there_is_refused_as_by_any_module():
    with pytest.raises(AttributeError, match="no attribute 'grow_trees'"):
        design.grow_trees  # noqa: B018


def test_a_room_is_not_loaded_before_it_is_asked_for():
    done = subprocess.run([sys.executable, "-c", QUICK], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
