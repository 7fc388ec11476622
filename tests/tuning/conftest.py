"""Optuna's plots take longer than the short searches of these tests."""

import pytest

from simrob_drake.tuning import study_folder, sweep_folder


@pytest.fixture(autouse=True, scope="module")
def _no_optuna_plots():
    """Write none in this process; plots and those who call for them have tests of their own."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (study_folder, sweep_folder):
            patch.setattr(module, "plots_there", lambda: False)
        yield
