from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from printctl.machine.link.find_link import alive
from printctl.machine.link.locking import lock

HELD = "some.lock"


def test_many_who_ask_at_once_dont_take_each_other_for_the_holder(tmp_path: Path) -> None:
    """Else a print whose station was killed was taken for one whose printer is in use again."""
    (tmp_path / HELD).touch()

    def ask(_: int) -> bool:
        return any(alive(tmp_path, HELD) for _ in range(500))

    with ThreadPoolExecutor(4) as pool:
        assert not any(pool.map(ask, range(4)))


def test_a_holder_is_seen(tmp_path: Path) -> None:
    with (tmp_path / HELD).open("a+b") as handle:
        lock(handle)
        assert alive(tmp_path, HELD)
    assert not alive(tmp_path, HELD)
