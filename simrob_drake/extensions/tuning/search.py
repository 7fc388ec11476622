"""Ways to search: local and global ones of scipy, and those of Optuna, each over parts of ranges, 0 to 1.

All ask for the costs of several points at once, and are the same for the same seed: so a search that was interrupted
is begun again, and what it had asked before is answered from what is kept.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Literal

import numpy as np

from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.tuning.study import Method

Costs = Callable[[Vector], tuple[Vector, Vector]]
"""What points (k, n) cost, shape (k, aims), and by how much they break limits, shape (k,), which costs as well."""
_Cost = Callable[[Vector], Vector]
_SPREAD = 0.2  # of the first points of CMA-ES about the start, as a part of the ranges
_NEAR = 0.1  # between the first corners of a simplex
_FEWEST = 5  # of a population
_ENDLESS = 10**9  # rounds: whoever tells the costs ends the search


class Enough(Exception):
    """As many points have been tried as were asked for."""


def search(
    method: Method, start: Vector, costs: Costs, *, together: int, seed: int, aims: int = 1
) -> None:
    """Ask for costs from a start (n,) on until that raises :class:`Enough`, or nothing better is near.

    ``nelder_mead`` and ``powell`` are local, the others global; ``together`` points are asked for at a time, where the
    method lets them be chosen so; more than one of ``aims`` is for methods of Optuna only. Raises SimrobError: the
    extra ``tune`` is missing.
    """
    ways = {"cma": _cma, "differential_evolution": _evolve, "nelder_mead": _local, "powell": _local}
    with suppress(Enough):
        if method in ways:
            ways[method](method, start, lambda points: costs(points)[0][:, 0], together, seed)
        else:
            _ask(method, start, costs, together, seed, aims)


def _local(method: str, start: Vector, costs: _Cost, _: int, seed: int) -> None:
    """Go downhill from the start, by a simplex or along one line after the other; nothing is drawn."""
    from scipy.optimize import minimize

    def cost(point: Vector) -> float:
        return float(costs(point[np.newaxis])[0])

    options: Any = {"maxfev": _ENDLESS, "maxiter": _ENDLESS}
    if method == "nelder_mead":
        options["initial_simplex"] = np.vstack(
            [start, start + np.diag(np.where(start + _NEAR > 1, -_NEAR, _NEAR))]
        )
    way: Literal["Nelder-Mead", "Powell"] = "Powell" if method == "powell" else "Nelder-Mead"
    minimize(cost, start, method=way, bounds=[(0.0, 1.0)] * len(start), options=options)


def _evolve(_: str, start: Vector, costs: _Cost, together: int, seed: int) -> None:
    from scipy.optimize import Bounds, differential_evolution

    source, population = np.random.default_rng(seed), max(together, _FEWEST)
    of_columns: Any = lambda points: costs(points.T)  # noqa: E731  # scipy hands over (n, k), which its stubs leave out
    differential_evolution(
        of_columns,
        Bounds(np.zeros_like(start), np.ones_like(start)),
        init=np.vstack([start, source.uniform(size=(population - 1, len(start)))]),
        rng=source,
        vectorized=True,
        updating="deferred",
        polish=False,
        maxiter=_ENDLESS,
    )


def _cma(_: str, start: Vector, costs: _Cost, together: int, seed: int) -> None:
    with importing_extra("cmaes", "tune"):
        from cmaes import CMA

    bounds = np.tile([0.0, 1.0], (len(start), 1))
    strategy = CMA(start, _SPREAD, bounds=bounds, seed=seed, population_size=max(together, _FEWEST))
    costs(start[np.newaxis])
    while not strategy.should_stop():
        points = np.array([strategy.ask() for _ in range(strategy.population_size)])
        strategy.tell(list(zip(points, costs(points).tolist(), strict=True)))


def _ask(method: str, start: Vector, costs: Costs, together: int, seed: int, aims: int) -> None:
    with importing_extra(method, "tune"):
        import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    samplers: dict[str, Callable[[], Any]] = {
        "tpe": lambda: optuna.samplers.TPESampler(seed=seed, constant_liar=True),
        "genetic": lambda: optuna.samplers.NSGAIISampler(
            population_size=max(together, _FEWEST), seed=seed
        ),
        "random": lambda: optuna.samplers.RandomSampler(seed=seed),
        "gp": lambda: _gaussian_process(seed),
    }
    names = [str(place) for place in range(len(start))]
    study = optuna.create_study(sampler=samplers[method](), directions=["minimize"] * aims)
    study.enqueue_trial(dict(zip(names, start.tolist(), strict=True)))
    while True:
        trials = [study.ask() for _ in range(together)]
        points = np.array(
            [[trial.suggest_float(name, 0.0, 1.0) for name in names] for trial in trials]
        )
        for trial, values, over in zip(trials, *costs(points), strict=True):
            trial.set_constraint("limits", float(over))
            study.tell(trial, values.tolist())


def _gaussian_process(seed: int) -> Any:
    with importing_extra(message("tuning.method_gp", "method gp"), "rl"):
        import torch  # noqa: F401  # which Optuna would miss only when it is asked
    from optuna.samplers import GPSampler

    return GPSampler(seed=seed, deterministic_objective=True)
