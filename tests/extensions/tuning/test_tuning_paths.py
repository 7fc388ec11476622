"""Files and folders of studies and sweeps are asked for as texts or as paths."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder
from simrob_drake.extensions.tuning.sweep_folder import SweepFolder
from tests.path_arguments import check_refusal

STUDY = Path(__file__).parents[3] / "examples" / "studies" / "irb120_gains.yaml"
GIVEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "Study.read": (Study.read, str(STUDY)),
}
ASKED: dict[str, Callable[[Any], Any]] = {
    "StudyFolder": partial(StudyFolder, study=Study.read(STUDY)),
    "StudyFolder.there": StudyFolder.there,
    "SweepFolder.there": SweepFolder.there,
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_text_is_a_path(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("time,q\n0,0\n1,1\n")
    call, text = GIVEN[name]
    call(text)


@pytest.mark.parametrize("name", [*GIVEN, *ASKED])
def test_what_is_no_path_is_told(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refusal(ASKED[name] if name in ASKED else GIVEN[name][0])
