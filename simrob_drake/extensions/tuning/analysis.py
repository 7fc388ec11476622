"""Searches and sweeps as Optuna knows them, for its plots and its dashboard.

The journal of a folder stays the only one: what Optuna looks at is made of its records, in memory.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.base.distributions import Choice, Distribution, Uniform
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.folders import writing
from simrob_drake.extensions.tuning.journal import COMPLETED, Record, Row
from simrob_drake.extensions.tuning.rollout import measured
from simrob_drake.extensions.tuning.study import Study, named

_DPI, _WIDTH, _HEIGHT = 110, 3.2, 4.0  # and inches of a slice
_MOST = 3  # keys whose trade-offs are drawn, those that matter most
_WIDE = 30.0  # from the least to the largest cost: beyond, logarithms are drawn


def study_in_optuna(
    name: str, study: Study, records: Sequence[Record], *, storage: Any = None
) -> Any:
    """Return a search as a study of Optuna.

    Its trials are complete, or pruned with the mean of the runs that were made; broken limits are constraints, and
    means of measures stand among the attributes. It is kept in memory unless a ``storage`` of Optuna's is given. Raises
    SimrobError: the extra ``tune`` is missing.
    """
    aims = list(named(np.zeros(len(study.aims))))
    found = _empty(name, aims, storage)
    add_trials(found, study, records)
    return found


def add_trials(found: Any, study: Study, records: Sequence[Record]) -> None:
    """Add the trials of a search that a study of Optuna has not."""
    from optuna.trial import TrialState, create_trial

    known = {trial.user_attrs["trial"] for trial in found.get_trials(deepcopy=False)}
    many = len(study.cases(study.start, study.search))
    kinds = _distributions(study.vary, [record.rows[0] for record in records])
    for record in records:
        if record.number in known:
            continue
        costs, over = study.mean(record.rows)
        pruned = len(record.rows) < many
        found.add_trial(
            create_trial(
                state=TrialState.PRUNED if pruned else TrialState.COMPLETE,
                values=None if pruned else costs.tolist(),
                **_parameters(kinds, record.rows[0]),
                user_attrs={
                    "trial": record.number,
                    "runs": len(record.rows),
                    **_means(record.rows),
                },
                intermediate_values={len(record.rows): float(costs[0])} if pruned else {},
                constraints={"limits": over} if study.limits or study.least else None,
            )
        )


def sweep_in_optuna(name: str, vary: Mapping[str, Distribution], rows: Sequence[Row]) -> Any:
    """Return a sweep's runs that ended as a study of Optuna of all measures; raises SimrobError: no extra ``tune``."""
    ended = [row for row in rows if row["ended"] == COMPLETED]
    names = [name for name, values in measured(ended).items() if len(values) == len(ended)]
    found = _empty(name, names or ["nothing"], None)
    from optuna.trial import create_trial

    kinds = _distributions(vary, ended)
    for row in ended if names else ():
        values = [row[name] for name in names]
        found.add_trial(create_trial(values=values, **_parameters(kinds, row)))
    return found


def save_sensitivity(file: Path, found: Any) -> None:
    """Write how much keys decide values, by PED-ANOVA, if they vary enough; raises OutputError: it is not written."""
    from optuna.visualization.matplotlib import plot_param_importances

    if _tells(found):
        _saved(file, partial(plot_param_importances, found))


def save_plots(found: Any, folder: Path) -> list[Path]:
    """Write Optuna's plots of a search, ``importance``, ``slices``, ``parallel``, ``trades``; return the files.

    With several costs there are those of each, and the ``front``. Nothing is written where too little varies. Raises
    OutputError: the disk does not take them.
    """
    from optuna.importance import get_param_importances
    from optuna.visualization import matplotlib as optuna_plots

    if not _tells(found):
        return []
    names = found.metric_names
    plots: dict[str, Callable[[], Any]] = {
        "importance": partial(optuna_plots.plot_param_importances, found)
    }
    for place, name in enumerate(names):
        target, label = _target(found, place, name)
        of: dict[str, Any] = {"target": target, "target_name": label}
        with warnings.catch_warnings(
            action="ignore"
        ):  # that low ones are taken for good ones, as they are here
            most = list(get_param_importances(found, target=target))[:_MOST]
        end = f"_{name}" if len(names) > 1 else ""
        plots[f"slices{end}"] = partial(optuna_plots.plot_slice, found, **of)
        plots[f"parallel{end}"] = partial(optuna_plots.plot_parallel_coordinate, found, **of)
        if len(most) > 1:
            plots[f"trades{end}"] = partial(optuna_plots.plot_contour, found, most, **of)
    if len(names) in (2, 3):
        plots["front"] = partial(optuna_plots.plot_pareto_front, found)
    many = len({key for trial in found.trials for key in trial.params})
    return [
        _saved(folder / f"{name}.png", plot, many if "slices" in name else 2)
        for name, plot in plots.items()
    ]


def save_convergence(file: Path, searches: Sequence[Any]) -> None:
    """Write the best so far over trials, of several costs their sum; raises OutputError: the disk does not take it."""
    from optuna.visualization.matplotlib import plot_optimization_history

    several = len(searches[0].directions) > 1
    target = (lambda trial: sum(trial.values)) if several else None
    _saved(
        file, partial(plot_optimization_history, list(searches), target=target, target_name="cost")
    )


def plots_there() -> bool:
    """Whether Optuna is there, whose plots they are."""
    return find_spec("optuna") is not None


def _empty(name: str, values: Sequence[str], storage: Any) -> Any:
    with importing_extra("Optuna", "tune"):
        import optuna
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    found = optuna.create_study(
        study_name=name, storage=storage, directions=["minimize"] * len(values)
    )
    with warnings.catch_warnings(action="ignore"):  # names are experimental, says Optuna
        found.set_metric_names(list(values))
    return found


def _distributions(vary: Mapping[str, Distribution], rows: Sequence[Row]) -> dict[str, Any]:
    """Return between which values each key varies: numbers lie in a range, others are a choice."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    found: dict[str, Any] = {}
    for key, one in vary.items():
        values = [value for row in rows if (value := row.get(key)) is not None]
        values = list(one.values) if isinstance(one, Choice) else values
        if values and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        ):
            found[key] = FloatDistribution(
                min(values), max(values), log=isinstance(one, Uniform) and one.log
            )
        elif values:
            found[key] = CategoricalDistribution(list(dict.fromkeys(map(_plain, values))))
    return found


def _parameters(kinds: Mapping[str, Any], row: Row) -> dict[str, Any]:
    """Return the values of a row, those that apply, and their distributions."""
    params = {key: _plain(row[key]) for key in kinds if row.get(key) is not None}
    return {"params": params, "distributions": {key: kinds[key] for key in params}}


def _plain(value: Any) -> Any:
    return value if isinstance(value, int | float | str | bool) else str(value)


def _means(rows: Sequence[Row]) -> dict[str, float]:
    """Return the mean of each measure over the runs of a trial."""
    numbered = [{"number": 0, **row} for row in rows]
    return {
        name: float(np.mean([value for value, _ in values]))
        for name, values in measured(numbered).items()
    }


def _tells(found: Any) -> bool:
    """Whether two trials differ."""
    whole = [trial.params for trial in found.trials if trial.values]
    return any(params != whole[0] for params in whole)


def _target(found: Any, place: int, name: str) -> tuple[Callable[[Any], float], str]:
    """Return what is drawn of a trial, and its name: a cost, or its logarithm where costs lie far apart."""
    costs = [trial.values[place] for trial in found.trials if trial.values]
    if min(costs) > 0 and max(costs) > _WIDE * min(costs):
        return lambda trial: float(np.log10(trial.values[place])), f"log10 {name}"
    return lambda trial: float(trial.values[place]), name


def _saved(file: Path, plot: Callable[[], Any], frames: int = 2) -> Path:
    """Write a plot of so many frames side by side, and let go of it; matplotlib stays as it was."""
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    with (
        writing(file),
        mpl.rc_context(),
        warnings.catch_warnings(action="ignore"),
    ):  # experimental, says Optuna
        figure = np.ravel(plot())[0].get_figure()
        try:
            figure.set_size_inches(_WIDTH * max(frames, 2), _HEIGHT)
            file.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(file, dpi=_DPI, bbox_inches="tight")
        finally:
            plt.close(figure)
    return file
