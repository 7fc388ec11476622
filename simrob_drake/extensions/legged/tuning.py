"""Better figures for a first walk, by a study like any other, and the proof of what it finds."""

import time
from collections.abc import Iterator, Mapping
from math import ceil
from pathlib import Path
from typing import Any

import yaml

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.folders import written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.legged.making import WALK
from simrob_drake.extensions.legged.report import TRIALS, attempt
from simrob_drake.extensions.tuning.proof import Proof, ProofFolder
from simrob_drake.extensions.tuning.study import Study
from simrob_drake.extensions.tuning.study_folder import StudyFolder
from simrob_drake.robots.catalog import load_robot_file
from simrob_drake.robots.gaits_file import GAITS_FILE
from simrob_drake.robots.urdf import mass_of
from simrob_drake.walking.parameters import REACTING

TUNING = "tuning"
_LOOP = "controllers.walk.gait"
_VARIED = (
    "step_time",
    "lift",
    "double_support",
    "bearing.height",
    "feedback.com_rate",
    "feedback.upright_rate",
)
_INWARD = 0.02  # m: either way where the zero-moment point goes, of robots with soles
_WIDE = {"bearing.height": 0.06}
_USUAL = 0.35  # part either way in which a figure is looked for
_PUSH = 0.3  # of the weight, for 0.1 s, in the conditions
_SEEDS, _RUNS = 2, 3  # draws of each doubt in the proof, and runs of a trial
_TOGETHER = 4


def tune_walk(folder: Path, minutes: float) -> Iterator[str]:
    """Search the figures of a walk for some minutes, write the winner into its gait, prove it; yield what came of it.

    The folder is what :func:`make_legged` made; the study goes into its ``tuning``. Raises SimrobError: a walk that
    cannot be tried.
    """
    station, begun = folder / WALK, time.monotonic()
    attempt(
        station, TRIALS[3], float(read_yaml(station)["controllers"]["walk"]["commands"][0]["ahead"])
    )
    trials = max(int(60 * minutes / (_RUNS * (time.monotonic() - begun))), _TOGETHER)
    file = folder / GAITS_FILE
    gaits = read_yaml(file)
    content = _study(station, gaits[REACTING], trials)
    study = Study(**content)
    place = StudyFolder(folder / TUNING, study, force=True)
    place.run(workers=1)
    found, (cost, *_) = place.best
    # in whole rounds, or fewer than asked
    before, many = (
        float(place.trials[0][1][0]),
        len(place.trials),
    )
    yield message(
        "legged.tuned",
        "tuned: {count} {count:trial|trials}, cost {before:.4g} before and {after:.4g} with the best",
        count=many,
        before=before,
        after=float(cost),
    )
    for key, value in found.items():
        *sections, last = key.removeprefix(f"{_LOOP}.").split(".")
        section = gaits[REACTING]
        for name in sections:
            section = section[name]
        yield f"{key.removeprefix(f'{_LOOP}.')}: {section[last]:g} -> {float(value):.4g}"
        section[last] = float(f"{float(value):.4g}")
    written_at_once(
        file,
        yaml.safe_dump(
            gaits, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
        ),
    )
    _, words = ProofFolder(
        folder / TUNING / "prove", Proof.of(str(folder / TUNING), _SEEDS), force=True
    ).run(workers=1)
    yield from words


def _study(station: Path, walk: Mapping[str, Any], trials: int) -> dict[str, Any]:
    """Return a study: figures about those of a walk, as far ahead as can be, pushed and not."""
    vary = {}
    for key in _VARIED:
        value: Any = walk
        for name in key.split("."):
            value = value[name]
        part = _WIDE.get(key, _USUAL)
        vary[f"{_LOOP}.{key}"] = {
            "low": value * (1 - part),
            "high": value * (1 + part),
            "start": value,
        }
    if walk["zmp_inward"]:
        value = walk["zmp_inward"]
        vary[f"{_LOOP}.zmp_inward"] = {
            "low": value - _INWARD,
            "high": value + _INWARD,
            "start": value,
        }
    robot = load_robot_file(station.parent / ROBOT_FILE).element
    weight = STANDARD_GRAVITY * sum(mass_of(link) for link in robot.iterfind("link"))

    def pushed(*ways: complex) -> list[dict[str, Any]]:
        """Return cases: undisturbed, and with a push each, as part of the weight along x and y, at some moment."""
        force = [
            (start, [_PUSH * weight * way.real, _PUSH * weight * way.imag, 0.0])
            for start, way in enumerate(ways, 3)
        ]
        return [
            {"forces.push": {"kind": "push", "start": start + 0.13, "force": push}}
            for start, push in force
        ]

    return {
        "station": str(station.absolute()),
        "overrides": {"duration": 10.0},
        "vary": vary,
        "cost": {"ahead": -1.0, "tilt": 1.0},
        "method": "cma",
        "trials": _TOGETHER * ceil(trials / _TOGETHER),
        "together": _TOGETHER,
        "search": {"cases": [{}, *pushed(0.7 + 0.7j, 0.7 - 0.7j)]},
        "proof": {"cases": [{"duration": 20.0}, *pushed(0.9j, -0.9j, 0.9, -0.9)]},
    }
