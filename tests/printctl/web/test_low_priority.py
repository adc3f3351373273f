import os
import sys

import pytest

from printctl.web.worker import lower_priority, run_at_low_priority


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process is behind as a whole")
def test_what_is_done_behind_a_print_leaves_the_rest_in_front() -> None:
    here = os.nice(0)

    def twice() -> int:
        lower_priority()
        lower_priority()
        return os.nice(0)

    assert run_at_low_priority(twice) == max(10, here)
    assert os.nice(0) == here
    assert run_at_low_priority(lambda: 3) == 3


def test_what_fails_behind_a_print_fails_in_front() -> None:
    with pytest.raises(ZeroDivisionError):
        run_at_low_priority(lambda: 1 // 0)
