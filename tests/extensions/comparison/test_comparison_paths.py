"""Files and folders of comparisons are asked for as texts or as paths."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from simrob_drake.extensions.comparison.engines import save_comparison
from tests.path_arguments import check_refusal

GIVEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "save_comparison": (partial(save_comparison, [], []), "comparison"),
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_text_is_a_path(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("time,q\n0,0\n1,1\n")
    call, text = GIVEN[name]
    call(text)


@pytest.mark.parametrize("name", GIVEN)
def test_what_is_no_path_is_told(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refusal(GIVEN[name][0])
