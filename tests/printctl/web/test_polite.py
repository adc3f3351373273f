import os
import sys

import pytest

from printctl.web.polite import behind_a_print, step_back


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process is behind as a whole")
def test_what_is_done_behind_a_print_leaves_the_rest_in_front() -> None:
    here = os.nice(0)

    def twice() -> int:
        step_back()
        step_back()
        return os.nice(0)

    assert behind_a_print(twice) == max(10, here)
    assert os.nice(0) == here
    assert behind_a_print(lambda: 3) == 3


def test_what_fails_behind_a_print_fails_in_front() -> None:
    with pytest.raises(ZeroDivisionError):
        behind_a_print(lambda: 1 // 0)
