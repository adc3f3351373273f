"""A named main branch is what one vessel follows along its planned way."""

import numpy as np

from design.anatomy.main_branches import MainBranch, Pieces, lost_branch, missing_branches


def pieces_along(line, parent):
    return Pieces(line[:-1], line[1:], np.full(len(line) - 1, 0.5), np.array(parent))


def test_side_branches_beside_the_way_of_a_main_branch_are_not_that_branch():
    """A posterior descending branch that ended halfway passed for whole where others ran by."""
    way = np.column_stack([np.linspace(0.0, 60.0, 13), np.zeros(13), np.zeros(13)])
    planned = MainBranch("posterior descending branch", 0, way, needed=True)
    whole = pieces_along(way, np.arange(-1, 11))
    assert not missing_branches((planned,), [whole])
    assert lost_branch((planned,), [whole]) is None
    # Below the first third the rest are ends of other branches: one way has them, not both.
    other = whole._replace(parent=np.array([-1, 0, 1, 2, -1, 4, 5, 6, 7, 8, 9, 10]))
    (note,) = missing_branches((planned,), [other])
    assert "lies along 70%" in note
    short = Pieces(*(column[:3] for column in whole))
    assert "lies along 2" in str(lost_branch((planned,), [short]))
    across = whole._replace(end=whole.begin + [0.0, 5.0, 0.0])
    assert "lies along 0%" in missing_branches((planned,), [across])[0]
