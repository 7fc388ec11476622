"""What may be otherwise than was thought: distributions of a station's keys, under which a winner is proven.

Each kind changes one thing alone, by a draw of its own for each seed.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.distributions import Choice, Distribution, Normal, Uniform, Values
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sampling import choose_seeds, seed_keys
from simrob_drake.base.sampling import draw_case as drawn_of
from simrob_drake.extensions.tuning.conclusion import NUMERICAL, THOUGHT
from simrob_drake.extensions.tuning.scene import ENGINE, GAIT, MUJOCO, Scene, in_mujoco
from simrob_drake.parts.sensors.sensor import SampledSensor
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.robots.feet import FootContact
from simrob_drake.robots.urdf import mass_of, name_of
from simrob_drake.simulation.runner import Runner
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import ONLY_ROBOT
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import ResolvedStation, resolve
from simrob_drake.stations.solver_config import ContinuousSolver

Change = Values
_Space = Mapping[str, Distribution]
_PUSH, _TURNS = np.linspace(0.1, 0.2, 5), np.arange(0.0, 360.0, 15.0)
"""How hard, in a robot's weights for a tenth of a second, and in which directions [deg]."""
_MOMENT = (0.3, 0.6)  # when, in parts of the run
_MASS = (0.8, 1.2)  # times, of each piece
_BALLAST, _PLACE = (
    (0.02, 0.1),
    0.03,
)  # of the mass of a robot that carries none, and how far from its root's origin [m]
_FRICTION = (0.6, 1.2)  # times
_JOINT_FRICTION = (0.004, 0.02)  # of a joint's torque limit
_STIFFNESS = (1 / 3, 3.0)  # times
_GAIN, _TORQUE = (
    (0.9, 1.1),
    (0.7, 1.0),
)  # times, of each joint's gains; of all torque limits, as supplies sag
_LINK = 0.05  # more or less, of the mass of each link
_STATIC, _DYNAMIC = (
    (0.5, 1.2),
    0.9,
)  # coefficient of static friction, and dynamic as a part of it: Simulink's 1 and 0.9
_POSTURE = 0.5  # deviation of each joint at the start [deg]
_SIZE, _PACE = (0.5, 1.0), (0.8, 1.25)  # of moves, times what was thought
_SIZES, _TIMES = ("target_deg", "amplitude_deg"), ("duration", "frequency")
"""What of a reference is a size and what a time."""
_SPEEDS = ("ahead", "sideways", "turn_deg")
_STREAM = 7_919  # apart from the streams of searches and sweeps
_SEEDS = 10**6
_FACTORS = 25  # where several values have one factor, it is one of so many


@dataclass(frozen=True)
class _Thought:
    """A scene as it was thought, its station, and the weights of its robots with what they carry [N]."""

    scene: Scene
    station: ResolvedStation
    weights: Mapping[str, float]

    @property
    def config(self) -> StationConfig:
        """The station's sections."""
        return self.scene.config

    def key(self, robot: str) -> str:
        """Return under which key a robot stands."""
        return robot if robot == self.config.only_robot == ONLY_ROBOT else f"robots.{robot}"

    def own(self, robot: str, section: str) -> str:
        """Return the key of a section that a robot has for itself, or has from the station."""
        return (
            f"{self.key(robot)}.{section}"
            if getattr(self.config.robots[robot], section)
            else section
        )

    def alone(self, robot: str, section: str) -> bool:
        """Whether a section is of this robot alone."""
        return (
            len(self.config.robots) == 1 or getattr(self.config.robots[robot], section) is not None
        )

    def held_back(self, robot: str) -> str:
        """Return what a push or a piece of a robot is called."""
        return "held_back" if self.config.only_robot else f"held_back_{robot}"


def doubts(scene: Scene, seeds: int) -> dict[str, list[Change]]:
    """Return changes, ``seeds`` of each kind, by kind, under which a scene is to be run again; the first has none."""
    found: dict[str, list[Change]] = {THOUGHT: [{}]}
    if not scene.config.engine.moves_by_forces:
        return found
    station = add_plant(DiagramBuilder(), resolve(scene.config))
    plant, context = station.plant, station.plant.CreateDefaultContext()
    masses = {
        name: plant.CalcTotalMass(context, [robot.instance])
        for name, robot in station.robots.items()
    }
    weights = {name: float(mass * abs(scene.config.gravity)) for name, mass in masses.items()}
    thought = _Thought(scene, resolve(scene.config), weights)
    for place, (kind, space_of) in enumerate(_KINDS.items()):
        if space := space_of(thought):
            found[kind] = [
                drawn_of(space, np.random.default_rng([_STREAM, place, seed]))
                for seed in range(seeds)
            ]
    engine = (
        {SECOND_ENGINE: [{ENGINE: MUJOCO}]} if scene.program is None and _in_mujoco(thought) else {}
    )
    return {**found, SOLVER: _other_solvers(scene.config), **engine}


def drawn(config: StationConfig, seed: int) -> Change:
    """Return one robot on the floor of many: of another posture, noise, masses of all links, and friction, at once."""
    station, draw = resolve(config), np.random.default_rng([_STREAM, _ROBOTS, seed])
    thought = _Thought(Scene(config), station, {})
    changed: Change = dict(choose_seeds(config.model_dump(), _STREAM + seed, {}))
    for name, robot in station.robots.items():
        units, (lower, upper) = robot.model.user_units, robot.model.axis_limits
        start = robot.initial + units * draw.normal(0, _POSTURE, len(robot.axes))
        changed[f"{thought.key(name)}.initial_deg"] = (
            np.clip(start, lower, upper) / units
        ).tolist()
    for name, robot in station.robots.items():
        heavy = [
            name_of(link) for link in robot.model.element.iterfind("link") if mass_of(link) > 0
        ]
        factors = draw.uniform(1 - _LINK, 1 + _LINK, len(heavy))
        changed[f"{thought.key(name)}.mass_factors"] = dict(
            zip(heavy, factors.tolist(), strict=True)
        )
    if config.contact is not None:
        static = float(draw.uniform(*_STATIC))
        changed["contact.friction"] = {"static": static, "dynamic": _DYNAMIC * static}
    return changed


def _times(value: float, factors: tuple[float, float]) -> Distribution:
    """Return what a value may be, times a factor between two."""
    low, high = sorted(float(value * factor) for factor in factors)
    return Uniform(low=low, high=high) if low < high else Choice(values=[low])


def _of_axes(key: str, values: Vector, spread: Sequence[Distribution]) -> _Space:
    """Return a distribution for each axis of a robot, below a key whose values for all (n,) it has before."""
    every = {f"{key}.{place}": one for place, one in enumerate(spread)}
    return {key: Choice(values=[values.tolist()]), **every}


def _together(factors: tuple[float, float], values: Callable[[float], Any]) -> Distribution:
    """Return what several values at once may be, by one factor between two."""
    return Choice(values=[values(float(factor)) for factor in np.linspace(*factors, _FACTORS)])


def _pushed(thought: _Thought) -> _Space:
    """Return a push of 0.1 s, level, in any direction, on the root of a robot that floats or the tool of an arm."""
    config, space = thought.config, dict[str, Distribution]()
    turns = [(float(np.cos(turn)), float(np.sin(turn))) for turn in np.deg2rad(_TURNS)]
    for robot, weight in thought.weights.items():
        key, at = f"forces.{thought.held_back(robot)}", None if config.only_robot else robot
        forces = [
            [size * weight * x, size * weight * y, 0.0] for size in _PUSH.tolist() for x, y in turns
        ]
        space[key] = Choice(values=[{"kind": "push", "at": at, "force": forces[0]}])
        space[f"{key}.start"] = _times(config.duration, _MOMENT)
        space[f"{key}.force"] = Choice(values=forces)
    return space


def _weighed(thought: _Thought) -> _Space:
    """Return other masses of all pieces; of robots on their feet without any, a load at each root."""
    pieces, gravity = thought.station.pieces.items(), abs(thought.config.gravity)
    space = {
        f"pieces.{name}.mass": _times(one.model.mass, _MASS)
        for name, one in pieces
        if one.model.mass > 0
    }
    floating = [robot for robot in thought.station.robots.values() if robot.floats]
    for robot in floating if gravity and not space else []:
        key, mass = f"pieces.{thought.held_back(robot.name)}", thought.weights[robot.name] / gravity
        section = {
            "model": "parcel",
            "parent": robot.name,
            "frame": robot.model.root,
            "pose": [0.0] * 6,
        }
        space |= {key: Choice(values=[section]), f"{key}.mass": _times(mass, _BALLAST)}
        space |= {f"{key}.pose.{place}": Uniform(low=-_PLACE, high=_PLACE) for place in range(3)}
    return space


def _slippery(thought: _Thought) -> _Space:
    """Return another friction of all that touches; without contact, dry friction in all joints."""
    contact = thought.config.contact
    if contact is not None:
        known = contact.friction
        static, dynamic = (
            (known.static, known.dynamic) if known else FootContact.model_fields["friction"].default
        )
        both = lambda part: {"static": part * static, "dynamic": part * dynamic}  # noqa: E731
        return {"contact.friction": _together(_FRICTION, both)}
    space = dict[str, Distribution]()
    for name, robot in thought.station.robots.items():
        limits = robot.gains.torque_limit
        if np.isfinite(limits).all() and not robot.gains.passive.any():
            key = f"{thought.key(name)}.drives.friction"
            space |= _of_axes(key, limits, [_times(limit, _JOINT_FRICTION) for limit in limits])
    return space


def _on_other_floor(thought: _Thought) -> _Space:
    """Return a softer or harder floor."""
    contact = thought.config.contact
    if contact is None or contact.model != "point":
        return {}
    feet = [
        robot.feet.stiffness for robot in thought.station.robots.values() if robot.feet is not None
    ]
    known = contact.stiffness or (
        feet[0] if feet else FootContact.model_fields["stiffness"].default
    )
    low, high = (known * factor for factor in _STIFFNESS)
    return {"contact.stiffness": Uniform(low=low, high=high, log=True)}


def _noisy(thought: _Thought) -> _Space:
    """Return other noise of all sensors and terrain, and joints that begin a little elsewhere."""
    seed = Uniform(low=0, high=_SEEDS, integer=True)
    space: dict[str, Distribution] = dict.fromkeys(seed_keys(thought.config.model_dump()), seed)
    for name, robot in thought.station.robots.items():
        units, limits = robot.model.user_units, robot.model.axis_limits
        start = np.clip(robot.initial, *limits) / units
        ends = [
            [end if np.isfinite(end) else None for end in (each / units).tolist()]
            for each in limits
        ]
        about = [
            Normal(mean=mean, deviation=_POSTURE, low=a, high=b)
            for mean, a, b in zip(start, *ends, strict=True)
        ]
        space |= _of_axes(f"{thought.key(name)}.initial_deg", start, about)
    return space


def _mistuned(thought: _Thought) -> _Space:
    """Return gains that are not quite those that were set, of each joint by a factor of its own."""
    space = dict[str, Distribution]()
    for name, robot in thought.station.robots.items():
        for gain in ("kp", "kd") if thought.alone(name, "servo") else ():
            values = getattr(robot.gains, gain)
            space |= _of_axes(
                f"{thought.own(name, 'servo')}.{gain}",
                values,
                [_times(one, _GAIN) for one in values],
            )
    return space


def _sagging(thought: _Thought) -> _Space:
    """Return lower torque limits of all joints of a robot, as of a battery that runs down."""
    space = dict[str, Distribution]()
    for name, robot in thought.station.robots.items():
        if np.isfinite(limits := robot.gains.torque_limit).all() and thought.alone(name, "servo"):
            # A passive axis has no limit. A key needs a positive number for it, which does not count.
            stated = np.where(robot.gains.passive, 1.0, limits)
            lower = [(stated * part).tolist() for part in np.linspace(*_TORQUE, _FACTORS)]
            space[f"{thought.own(name, 'servo')}.torque_limit"] = Choice(values=lower)
    return space


def _late(thought: _Thought) -> _Space:
    """Return measurements that reach the loops later, by up to one sample."""
    sensors = thought.config.sensors if thought.config.controllers else {}
    sampled = {
        name: sensor for name, sensor in sensors.items() if isinstance(sensor, SampledSensor)
    }
    return {
        f"sensors.{name}.delay": Uniform(low=sensor.delay, high=sensor.delay + 1 / sensor.rate)
        for name, sensor in sampled.items()
    }


def _moved(thought: _Thought) -> _Space:
    """Return other moves: each robot's own, its gait, and what it is told to walk, smaller and quicker or slower."""
    scene, space = thought.scene, dict[str, Distribution]()
    if scene.motion is not None:
        gaits = gaits_of(scene.motion.model, steps=True)
        scaled = scene.gait_keys.get("name", next(iter(gaits), None)) in gaits
        return (
            {f"{GAIT}.amplitude": _times(scene.gait_keys.get("amplitude", 1.0), _SIZE)}
            if scaled
            else {}
        )
    for name in thought.station.robots if scene.program is None else ():
        space |= _scaled(
            thought.config.reference_of(name).model_dump(), thought.own(name, "reference")
        )
    for name, section in thought.config.controllers.items():
        if commands := section.model_dump().get("commands"):
            space[f"controllers.{name}.commands"] = _resized(commands, _SPEEDS)
    return space


def _scaled(reference: Mapping[str, Any], key: str) -> _Space:
    """Return what a reference's sizes may be, by a factor for each axis, and its times."""
    times = [name for name in _TIMES if reference.get(name)]
    space = {f"{key}.{name}": _times(reference[name], _PACE) for name in times}
    for name in _SIZES:
        value: Any = list(found) if isinstance(found := reference.get(name), tuple) else found
        of_axes = list(
            value.items()
            if isinstance(value, Mapping)
            else enumerate(value)
            if np.ndim(value)
            else ()
        )
        space |= {f"{key}.{name}": Choice(values=[value])} if of_axes else {}
        space |= {f"{key}.{name}.{axis}": _times(one, _SIZE) for axis, one in of_axes}
        space |= {f"{key}.{name}": _times(value, _SIZE)} if value and not of_axes else {}
    if targets := reference.get("targets"):
        space[f"{key}.targets"] = _resized(targets, _SIZES)
    return space


def _resized(entries: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> Distribution:
    """Return what entries of a list may be, some of their keys by one factor."""

    def times(value: Any, factor: float) -> Any:
        if isinstance(value, Mapping):
            return {axis: factor * one for axis, one in value.items()}
        return (factor * np.asarray(value)).tolist()

    def resized(factor: float) -> list[Values]:
        return [
            {**one, **{key: times(one[key], factor) for key in keys if key in one}}
            for one in entries
        ]

    return _together(_SIZE, resized)


_KINDS: dict[str, Callable[[_Thought], _Space]] = {
    "pushes": _pushed,
    "masses": _weighed,
    "friction": _slippery,
    "floor": _on_other_floor,
    "noise": _noisy,
    "moves": _moved,
    "gains": _mistuned,
    "torque": _sagging,
    "latency": _late,
}
_ROBOTS = 5  # the place of the stream of whole robots, from when there were so many kinds
SOLVER, SECOND_ENGINE = NUMERICAL
MOVES = "moves"
KINDS = (*_KINDS, SOLVER, SECOND_ENGINE)  # all that can be doubted
UNKNOWN = ("backlash",)  # what no doubt changes, as too little is known of it; conditions may


def moves(scene: Scene) -> bool:
    """Tell whether something is asked that could be another move: by a gait, a program, references or commands."""
    asked = [scene.config.reference_of(name).model_dump()["kind"] for name in scene.config.robots]
    commanded = any(
        section.model_dump().get("commands") for section in scene.config.controllers.values()
    )
    return bool(scene.motion or scene.program or commanded or set(asked) - {"hold"})


def _other_solvers(config: StationConfig) -> list[Change]:
    """Return the station's solver four times as tight, with error control; and another one, which is not its kind."""
    tighter = config.solver.tighter(4.0).model_dump()
    if not isinstance(config.solver, ContinuousSolver):
        return [{"solver": tighter}]
    tight = {"kind": "continuous", "scheme": "runge_kutta3", "accuracy": 1e-4, "max_step": 0.01}
    other = tight if config.contact is None else {"kind": "discrete"}
    return [{"solver": {**tighter, "error_control": True}}, {"solver": other}]


def _in_mujoco(thought: _Thought) -> bool:
    """Check whether MuJoCo is installed and can run a station."""
    if find_spec("mujoco") is None:
        return False
    with suppress(SimrobError):
        with needed_extension("mujoco", message("tuning.a_second_engine", "a second engine")):
            from simrob_drake.extensions.mujoco.built import check_sayable
        if thought.config.controllers:
            Runner(in_mujoco(thought.config))
        else:
            check_sayable(thought.config, thought.station.robots)
        return True
    return False
