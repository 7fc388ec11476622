"""What may be otherwise than was thought: changes of a station under which a winner is proven.

Each kind changes one thing alone, by a draw of its own for each seed.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.errors import SimrobError
from simrob_drake.mujoco.limits import check_sayable
from simrob_drake.robots.feet import FootContact
from simrob_drake.robots.urdf import mass_of, name_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import ResolvedStation, resolve
from simrob_drake.stations.solver_config import ContinuousSolver
from simrob_drake.tuning.conclusion import NUMERICAL, THOUGHT
from simrob_drake.tuning.scene import ENGINE, MUJOCO
from simrob_drake.tuning.streams import seeded

Change = dict[str, Any]
_PUSH = 0.2  # at most, of a robot's weight, for a tenth of a second
_MOMENT = (0.3, 0.6)  # when, in parts of the run
_MASS = 0.2  # more or less, of each piece
_BALLAST = 0.1  # at most, of the mass of a robot that carries none
_FRICTION = (0.6, 1.2)  # times
_JOINT_FRICTION = 0.02  # at most, of a joint's torque limit
_STIFFNESS = 3.0  # times, or a part
_LINK = 0.05  # more or less, of the mass of each link
_STATIC, _DYNAMIC = (0.5, 1.2), 0.9  # coefficient of static friction, and dynamic as a part of it: Simulink's 1 and 0.9
_POSTURE = 0.5  # deviation of each joint at the start [deg]
_SIZE, _PACE = (0.5, 1.0), (0.8, 1.25)  # of moves, times what was thought
_SIZES, _TIMES = ("target_deg", "amplitude_deg"), ("duration", "frequency")
"""What of a reference is a size and what a time."""
_SPEEDS = ("ahead", "sideways", "turn_deg")
_STREAM = 7_919  # apart from the streams of searches and sweeps


@dataclass(frozen=True)
class _Thought:
    """A station as it was thought, and the weights of its robots with what they carry [N]."""

    config: StationConfig
    station: ResolvedStation
    weights: Mapping[str, float]

    def key(self, robot: str) -> str:
        """Return under which key a robot stands."""
        return robot if robot == self.config.only_robot == ONLY_ROBOT else f"robots.{robot}"


def doubts(config: StationConfig, seeds: int, *, second_engine: bool = True) -> dict[str, list[Change]]:
    """Return by their kinds the changes under which a station is to be run again; the first kind has none.

    Args:
        config: the station as it was thought.
        seeds: how many draws of each kind.
        second_engine: whether what is done there can be done in MuJoCo, too, if MJCF can say the station.
    """
    found: dict[str, list[Change]] = {THOUGHT: [{}]}
    if config.mode == "kinematic":
        return found
    thought = _Thought(config, resolve(config), _weights(config))
    for place, (kind, change) in enumerate(_KINDS.items()):
        drawn = [change(thought, np.random.default_rng([_STREAM, place, seed]), seed) for seed in range(seeds)]
        found |= {kind: drawn} if all(drawn) else {}
    engine = {SECOND_ENGINE: [{ENGINE: MUJOCO}]} if second_engine and _in_mujoco(thought) else {}
    return {**found, SOLVER: _other_solvers(config), **engine}


def drawn(config: StationConfig, seed: int) -> Change:
    """Return one robot on the floor of many: of another posture, noise, masses of all links, and friction, at once."""
    thought, draw = _Thought(config, resolve(config), {}), np.random.default_rng([_STREAM, _ROBOTS, seed])
    changed = _noisy(thought, draw, seed)
    for name, robot in thought.station.robots.items():
        heavy = [name_of(link) for link in robot.model.element.iterfind("link") if mass_of(link) > 0]
        factors = draw.uniform(1 - _LINK, 1 + _LINK, len(heavy))
        changed[f"{thought.key(name)}.mass_factors"] = dict(zip(heavy, factors.tolist(), strict=True))
    if config.contact is not None:
        static = float(draw.uniform(*_STATIC))
        changed["contact.friction"] = {"static": static, "dynamic": _DYNAMIC * static}
    return changed


def _pushed(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return a push of 0.1 s, level, in any direction, on the root of a robot that floats or the tool of an arm."""
    config, robots = thought.config, list(thought.weights)
    if not robots:
        return {}
    robot = robots[seed % len(robots)]
    size, turn = draw.uniform(0.5, 1.0) * _PUSH * thought.weights[robot], draw.uniform(0, 2 * np.pi)
    push = {
        "kind": "push",
        "at": None if config.only_robot else robot,
        "start": float(draw.uniform(*_MOMENT) * config.duration),
        "force": [float(size * np.cos(turn)), float(size * np.sin(turn)), 0.0],
    }
    return {"forces.held_back": push}


def _weighed(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return other masses of all pieces; of a robot on its feet without any, a load at its root."""
    pieces, gravity = thought.station.pieces.items(), abs(thought.config.gravity)
    masses = {name: piece.model.mass * draw.uniform(1 - _MASS, 1 + _MASS) for name, piece in pieces}
    changed: Change = {f"pieces.{name}.mass": float(mass) for name, mass in masses.items() if mass > 0}
    floating = [robot for robot in thought.station.robots.values() if robot.floats]
    if changed or not floating or not gravity:
        return changed
    robot = floating[seed % len(floating)]
    mass = draw.uniform(0.2, 1.0) * _BALLAST * thought.weights[robot.name] / gravity
    place = [*draw.uniform(-0.03, 0.03, 3).tolist(), 0.0, 0.0, 0.0]
    hung = {"parent": robot.name, "frame": robot.model.root, "pose": place}
    return {"pieces.held_back": {"model": "parcel", "mass": float(mass), **hung}}


def _slippery(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return another friction of all that touches; without contact, dry friction in all joints."""
    contact = thought.config.contact
    if contact is not None:
        known, part = contact.friction, float(draw.uniform(*_FRICTION))
        static, dynamic = (known.static, known.dynamic) if known else FootContact.model_fields["friction"].default
        return {"contact.friction": {"static": part * static, "dynamic": part * dynamic}}
    changed: Change = {}
    for name, robot in thought.station.robots.items():
        limits = robot.gains.torque_limit
        share = draw.uniform(0.2, 1.0, len(limits)) * _JOINT_FRICTION
        if np.isfinite(limits).all():
            changed[f"{thought.key(name)}.drives.friction"] = (share * limits).tolist()
    return changed


def _moved(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return other moves: each robot's own, and what it is told to walk, smaller and quicker or slower."""
    changed: Change = {}
    for name in thought.station.robots:
        key = f"{thought.key(name)}.reference" if thought.config.robots[name].reference else "reference"
        changed |= _scaled(thought.config.reference_of(name).model_dump(), key, draw)
    for name, section in thought.config.controllers.items():
        if commands := section.model_dump().get("commands"):
            size = draw.uniform(*_SIZE)
            slower = [{**one, **{key: one[key] * size for key in _SPEEDS}} for one in commands]
            changed[f"controllers.{name}.commands"] = slower
    return changed


def _scaled(reference: Mapping[str, Any], key: str, draw: np.random.Generator) -> Change:
    """Return changes of a reference's sizes, by a factor for each axis, and of its times by one."""
    times = draw.uniform(*_PACE)
    changed: Change = {f"{key}.{name}": reference[name] * times for name in _TIMES if reference.get(name)}
    for name in _SIZES:
        value = reference.get(name)
        if isinstance(value, Mapping):
            changed[f"{key}.{name}"] = {axis: one * draw.uniform(*_SIZE) for axis, one in value.items()}
        elif isinstance(value, (list, tuple)):
            changed[f"{key}.{name}"] = [one * draw.uniform(*_SIZE) for one in value]
        elif value:
            changed[f"{key}.{name}"] = value * draw.uniform(*_SIZE)
    return changed


def _on_other_floor(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return a softer or harder floor."""
    contact = thought.config.contact
    if contact is None or contact.model != "point":
        return {}
    feet = [robot.feet.stiffness for robot in thought.station.robots.values() if robot.feet is not None]
    known = contact.stiffness or (feet[0] if feet else FootContact.model_fields["stiffness"].default)
    return {"contact.stiffness": float(known * _STIFFNESS ** draw.uniform(-1, 1))}


def _noisy(thought: _Thought, draw: np.random.Generator, seed: int) -> Change:
    """Return other noise of all sensors and terrain, and joints that begin a little elsewhere."""
    changed: Change = dict(seeded(thought.config.model_dump(), _STREAM + seed, {}))
    for name, robot in thought.station.robots.items():
        units, (lower, upper) = robot.model.user_units, robot.model.axis_limits
        start = robot.initial + units * draw.normal(0, _POSTURE, len(robot.axes))
        changed[f"{thought.key(name)}.initial_deg"] = (np.clip(start, lower, upper) / units).tolist()
    return changed


_KINDS: dict[str, Callable[[_Thought, np.random.Generator, int], Change]] = {
    "pushes": _pushed,
    "masses": _weighed,
    "friction": _slippery,
    "floor": _on_other_floor,
    "noise": _noisy,
    "moves": _moved,
}
_ROBOTS = 5
"""The place of the stream of whole robots, from when there were so many kinds."""
SOLVER, SECOND_ENGINE = NUMERICAL
KINDS = (*_KINDS, SOLVER, SECOND_ENGINE)
"""All that can be doubted."""


def _other_solvers(config: StationConfig) -> list[Change]:
    """Return the station's solver four times as tight, with error control; and another one, which is not its kind."""
    tighter = config.solver.tighter(4.0).model_dump()
    if not isinstance(config.solver, ContinuousSolver):
        return [{"solver": tighter}]
    tight = {"kind": "continuous", "scheme": "runge_kutta3", "accuracy": 1e-4, "max_step": 0.01}
    other = tight if config.contact is None else {"kind": "discrete"}
    return [{"solver": {**tighter, "error_control": True}}, {"solver": other}]


def _in_mujoco(thought: _Thought) -> bool:
    """Tell whether there is a MuJoCo that can run a station."""
    if find_spec("mujoco") is None:
        return False
    with suppress(SimrobError):
        check_sayable(thought.config, thought.station.robots)
        return True
    return False


def _weights(config: StationConfig) -> dict[str, float]:
    """Return the weights of the robots with what they carry [N]."""
    station = add_plant(DiagramBuilder(), resolve(config))
    plant, context = station.plant, station.plant.CreateDefaultContext()
    masses = {name: plant.CalcTotalMass(context, [robot.instance]) for name, robot in station.robots.items()}
    return {name: float(mass * abs(config.gravity)) for name, mass in masses.items()}
