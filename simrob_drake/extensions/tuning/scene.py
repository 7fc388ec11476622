"""What is run: a station alone, a gait of its robot, or a program, each with figures changed.

Beside keys of the station an override may name those of a gait of ``gaits.yaml`` (``gait.name``, ``gait.steps``,
``gait.amplitude``, ``gait.step_time``, ``gait.bearing.height`` ...) or those of a program (``program``, its file, and
``program.moves.0.duration`` ...). ``engine: mujoco`` runs it in MuJoCo, several times as fast where nothing in it
decides as it goes.
"""

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.trajectories import Trajectory

from simrob_drake.base.errors import InvalidConfig, UnknownName, one_of
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.files import ROBOT_FILE
from simrob_drake.base.folders import writing, written_at_once
from simrob_drake.base.messages import message
from simrob_drake.base.sections import validate_section
from simrob_drake.base.yaml_files import place_of
from simrob_drake.parts.forces import Push
from simrob_drake.programs.arm import Workcell
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.gaits.walker import Walker
from simrob_drake.programs.program import Program
from simrob_drake.programs.whole_program import carried_program, perform
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import load_robot_file
from simrob_drake.simulation import ReferenceLike, Runner
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import with_copied_files
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.resolve import resolve

_KEPT: deque[Runner] = deque(maxlen=4)  # some megabytes each


def run(config: StationConfig, reference: ReferenceLike | None = None) -> SimulationResult:
    """Run a station as :func:`~simrob_drake.simulation.simulate`, to the last bit; raises SimrobError: wrong input."""
    return runner_of(config).run(reference=reference)


def runner_of(config: StationConfig) -> Runner:
    """Return the runner of a station.

    What was built for a run of the same station with other references, pushes, length or start is used again. Raises
    SimrobError: a station that cannot be run at all.
    """
    runner = next((found for kept in _KEPT if (found := kept.like(config)) is not None), None)
    if runner is None:
        runner = Runner(config)
        _KEPT.append(runner)
    return runner


GAIT, PROGRAM, ENGINE = "gait", "program", "engine"
DRAKE, MUJOCO = "drake", "mujoco"
_STEPS = 12  # of a gait, unless told


@dataclass(frozen=True)
class Scene:
    """A station, and what is done in it."""

    config: StationConfig  # the station
    motion: JointMotion | None = None  # the gait that its robot goes, if any
    program: Program | None = None  # what is done, if any
    # what was asked of the gait, by its keys
    gait_keys: Mapping[str, Any] = field(default_factory=dict)
    engine: str = DRAKE  # in which it is run

    @classmethod
    def of(
        cls,
        station: str,
        overrides: Mapping[str, Any],
        *,
        called: Mapping[str, str] | None = None,
        allow_code: bool = False,
    ) -> "Scene":
        """Return a station, by name or file, with overrides of it, its robot's gait or its program, if any.

        Errors call an override by ``called``. Raises SimrobError: a station, a gait or a program that cannot be.
        """
        own = of_station(overrides)
        names = {key: name for key, name in (called or {}).items() if key in own}
        config = load_station(station, own, called=names, allow_code=allow_code)
        engine = one_of(
            message("tuning.engine", "engine"), overrides.get(ENGINE, DRAKE), (DRAKE, MUJOCO)
        )
        gait: dict[str, Any] = {}
        for key, value in overrides.items():
            if key == GAIT:
                gait |= value if isinstance(value, Mapping) else {"name": value}
            elif key.startswith(f"{GAIT}."):
                gait[key.partition(".")[2]] = value
        program = carried_program(config)
        if gait and any(key.partition(".")[0] == PROGRAM for key in own):
            raise InvalidConfig(
                station,
                GAIT,
                message(
                    "tuning.beside_a_program",
                    "stands beside a program: a robot does one or the other",
                ),
            )
        if program and not gait:
            if engine != DRAKE:
                raise InvalidConfig(
                    station,
                    ENGINE,
                    message(
                        "tuning.engine_without_programs",
                        "is {engine}, which does no programs: they need {drake}",
                        engine=engine,
                        drake=DRAKE,
                    ),
                )
            return cls(config, program=program)
        if not gait:
            return cls(config, engine=engine)
        if config.only_robot is None:
            raise InvalidConfig(
                station,
                GAIT,
                message(
                    "tuning.station_of_one_robot",
                    "needs a station of one robot, and this has {count}",
                    count=len(config.robots),
                ),
            )
        folder = resolve(config).robots[config.only_robot].model.folder
        motion = _motion(str(folder / ROBOT_FILE), json.dumps(gait, sort_keys=True))
        return cls(motion.station(own, name=station), motion=motion, gait_keys=gait, engine=engine)

    @property
    def digest(self) -> str:
        """A short text that is another one for another station, gait or program."""
        found = sha256(station_yaml(self.config).encode())
        if self.motion is not None:
            found.update(np.ascontiguousarray(self.motion.positions).tobytes())
        if self.program is not None:
            found.update(self.program.text().encode())
        found.update(self.engine.encode() if self.engine != DRAKE else b"")
        return found.hexdigest()[:16]

    @property
    def reference(self) -> Trajectory | None:
        """The joint positions of its gait over time; None where the station says itself what is asked."""
        return None if self.motion is None else self.motion.trajectory()

    def check(self) -> None:
        """Check, unrun, that robots can follow what they are asked, programs apart; raises SimrobError: they cannot."""
        if self.program is None:
            Runner(self.config).check(self.reference)

    def run(self) -> SimulationResult:
        """Run it; what is built already is used where that can be; raises SimrobError: what cannot be run."""
        decides = self.program is not None or bool(self.config.controllers)
        config = in_mujoco(self.config) if self.engine == MUJOCO and decides else self.config
        if self.program is not None:
            return perform(Workcell(config), self.program)
        if self.engine == DRAKE or decides:
            return run(config, self.reference)
        with (
            importing_extra("MuJoCo", MUJOCO),
            needed_extension(MUJOCO, message("tuning.engine_mujoco", "engine: mujoco")),
        ):
            from simrob_drake.extensions.mujoco.runner import MujocoRunner
        return MujocoRunner(self.config).run(reference=self.reference)

    def pushed(self, name: str, size: float) -> "Scene":
        """Return it with a push so many times as hard, 0 for none; raises UnknownName: no such push."""
        pushes = {
            name: force for name, force in self.config.forces.items() if isinstance(force, Push)
        }
        push = pushes[one_of(message("tuning.push", "push"), name, pushes)]
        harder = push.model_copy(update={"force": tuple(size * part for part in push.force)})
        return replace(
            self,
            config=self.config.model_copy(update={"forces": {**self.config.forces, name: harder}}),
        )

    def write(self, folder: Path) -> None:
        """Write ``station.yaml`` and its files, a gait's or a program's YAML; raises OutputError: not written."""
        with writing(folder):
            config = with_copied_files(self.config, folder)
        written_at_once(folder / "station.yaml", station_yaml(config))
        if self.program is not None:
            self.program.save(folder / "program.yaml")
        if self.gait_keys:
            written_at_once(
                folder / "gait.yaml", yaml.safe_dump(dict(self.gait_keys), sort_keys=False)
            )


def in_mujoco(config: StationConfig) -> StationConfig:
    """Copy a station with MuJoCo as its engine, at the engine's default step length.

    Raises:
        MissingExtension: the extension ``mujoco`` is not installed, or is left out.
    """
    with needed_extension(MUJOCO, message("tuning.engine_mujoco", "engine: mujoco")):
        from simrob_drake.extensions.mujoco.engine import MujocoEngine
    return config.model_copy(update={"solver": MujocoEngine(kind="mujoco")})


def of_station(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of some changes that are of the station."""
    return {
        key: value
        for key, value in overrides.items()
        if key.partition(".")[0] not in (GAIT, ENGINE)
    }


@lru_cache(maxsize=4)
def _motion(robot_file: str, keys_text: str) -> JointMotion:
    """Plan a gait, which takes about as long as its run: once for all conditions under which it is tried."""
    robot, keys = load_robot_file(Path(robot_file)), json.loads(keys_text)
    known = {**gaits_of(robot, steps=True), **gaits_of(robot, steps=False)}
    name = keys.pop("name", next(iter(known)))
    if name not in known:
        raise UnknownName(
            message("tuning.gait_of", "gait of {robot}", robot=robot.name), name, known
        )
    gait = known[name]
    steps, amplitude = (
        (keys.pop("steps", _STEPS), keys.pop("amplitude", 1.0)) if gait.steps else (0, 1.0)
    )
    content = gait.model_dump(exclude_unset=True)
    for key, value in keys.items():
        section, last = place_of(
            content, key.split("."), message("tuning.gait_called", "gait {name}", name=name)
        )
        section[int(last) if isinstance(section, list) else last] = value
    validate_section(type(gait), content, message("tuning.gait_called", "gait {name}", name=name))
    changed = {key.partition(".")[0] for key in keys}
    return gait.with_changes({key: content[key] for key in changed}, amplitude, name).plan(
        Walker.of(robot), steps, amplitude
    )
