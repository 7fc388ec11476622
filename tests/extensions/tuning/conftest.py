"""Trials of these tests are short: Optuna's plots, and other processes, take longer to begin than they take."""

import pytest

from simrob_drake.extensions.tuning import journal, study_folder, sweep_folder
from simrob_drake.extensions.tuning import processes as real
from tests.extensions.tuning.here import Here


@pytest.fixture(autouse=True, scope="module")
def _no_optuna_plots():
    """Write none in this process; plots and those who call for them have tests of their own."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (study_folder, sweep_folder):
            patch.setattr(module, "plots_there", lambda: False)
        yield


@pytest.fixture(autouse=True, scope="module")
def _here():
    """Make trials in this process, or on the cluster that is asked for."""

    def engine(*, workers=None, scheduler=None):
        return real.Cluster(scheduler) if scheduler else Here()

    with pytest.MonkeyPatch.context() as patch:
        for module in (journal, study_folder):
            patch.setattr(module, "engine", engine)
        yield


@pytest.fixture
def processes(monkeypatch):
    """Make trials in processes of their own, as users do."""
    for module in (journal, study_folder):
        monkeypatch.setattr(module, "engine", real.engine)
