"""Files and folders of the exchange with Simulink are asked for as texts or as paths."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from simrob_drake import load_station
from simrob_drake.extensions.simulink.fmi.unit import write_fmu
from simrob_drake.extensions.simulink.importing import import_simulink
from simrob_drake.extensions.simulink.logs import read_log, save_differences
from tests.path_arguments import check_refusal

GIVEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "write_fmu": (partial(write_fmu, load_station("double_pendulum")), "pendulum.fmu"),
    "read_log": (partial(read_log, names={}), "log.csv"),
    "save_differences": (partial(save_differences, []), "differences"),
}
ASKED: dict[str, Callable[[Any], Any]] = {
    "import_simulink": partial(import_simulink, folder="imported"),
    "import_simulink to": partial(import_simulink, "model.slx"),
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
