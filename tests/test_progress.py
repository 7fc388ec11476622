"""What long work says where nobody watches: a remark now and then, and the last of all."""

import pytest

from simrob_drake.base import progress
from simrob_drake.base.progress import progress_bar


@pytest.mark.parametrize(
    ("seldom", "told"), [(60, ["work: 3"]), (0, ["work: 1", "work: 2", "work: 3"])]
)
def test_a_log_ends_with_the_last_remark(seldom, told, capsys, monkeypatch):
    """So what is said first, the cost where a search begins, isn't all that it says."""
    monkeypatch.setattr(progress, "SELDOM", seldom)
    with progress_bar("work", 3, shown=True) as move:
        for done in (1, 2, 3):
            move(done, str(done))
    assert capsys.readouterr().err.splitlines() == told


def test_work_that_is_interrupted_tells_how_far_it_came(capsys):
    def work():
        with progress_bar("work", 3, shown=True) as move:
            move(1, "1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert capsys.readouterr().err == "work: 1\n"
