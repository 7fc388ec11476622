"""What is run: a station alone, a gait of its robot, or a program, each with figures changed.

Beside keys of the station an override may name those of a gait of ``gaits.yaml`` (``gait.name``, ``gait.steps``,
``gait.amplitude``, ``gait.step_time``, ``gait.bearing.height`` ...) or those of a program (``program.file``,
``program.moves.0.duration`` ...). ``engine: mujoco`` runs it in MuJoCo, several times as fast where MJCF can say it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.trajectories import Trajectory

from simrob_drake.errors import InvalidConfig, UnknownName, one_of, quoted
from simrob_drake.extras import needed
from simrob_drake.folders import written_at_once
from simrob_drake.parts.forces import Push
from simrob_drake.programs.gaits.motion import JointMotion
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.program import Program
from simrob_drake.programs.whole_program import perform
from simrob_drake.programs.workcell import Workcell
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import ROBOT_FILE, load_robot_file
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import load_station, station_yaml
from simrob_drake.stations.resolve import resolve
from simrob_drake.tuning.runners import run
from simrob_drake.yaml_files import read_yaml, validated

GAIT, PROGRAM, ENGINE = "gait", "program", "engine"
DRAKE, MUJOCO = "drake", "mujoco"
_STEPS = 12  # of a gait, unless told


@dataclass(frozen=True)
class Scene:
    """A station, and what is done in it.

    Attributes:
        config: the station.
        motion: the gait that its robot goes, if any.
        program: what is done, if any.
        told: what was asked of the gait, by its keys.
        engine: in which it is run.
    """

    config: StationConfig
    motion: JointMotion | None = None
    program: Program | None = None
    told: Mapping[str, Any] = field(default_factory=dict)
    engine: str = DRAKE

    @classmethod
    def of(
        cls,
        station: str,
        overrides: Mapping[str, Any],
        *,
        called: Mapping[str, str] | None = None,
        allow_code: bool = False,
    ) -> "Scene":
        """Return a station with changes, and with the gait or the program that they name.

        Args:
            station: a name or a file.
            overrides: what is changed in the station, in its robot's gait or in the program.
            called: what errors call an override by its key.
            allow_code: whether the station may name Python code.

        Raises:
            SimrobError: a station, a gait or a program that cannot be.
        """
        own = of_station(overrides)
        names = {key: name for key, name in (called or {}).items() if key in own}
        config = load_station(station, own, called=names, allow_code=allow_code)
        engine = one_of("engine", overrides.get(ENGINE, DRAKE), (DRAKE, MUJOCO))
        gait, program = (_section(overrides, name) for name in (GAIT, PROGRAM))
        if gait and program:
            raise InvalidConfig(station, GAIT, "stands beside a program: a robot does one or the other")
        if program and engine != DRAKE:
            raise InvalidConfig(station, ENGINE, f"is {engine}, which does no programs: they need {DRAKE}")
        if program:
            return cls(config, program=_program(program))
        if not gait:
            return cls(config, engine=engine)
        if config.only_robot is None:
            raise InvalidConfig(station, GAIT, f"needs a station of one robot, and this has {len(config.robots)}")
        folder = resolve(config).robots[config.only_robot].model.folder
        motion = _motion(str(folder / ROBOT_FILE), json.dumps(gait, sort_keys=True))
        return cls(motion.station(own, name=station), motion=motion, told=gait, engine=engine)

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

    def run(self) -> SimulationResult:
        """Run it; what is built already is used where that can be.

        Raises:
            SimrobError: what cannot be run.
        """
        if self.program is not None:
            return perform(Workcell(self.config), self.program)
        if self.engine == DRAKE:
            return run(self.config, self.reference)
        with needed("MuJoCo", MUJOCO):
            from simrob_drake.mujoco.runner import MujocoRunner
        return MujocoRunner(self.config).run(reference=self.reference)

    def pushed(self, name: str, size: float) -> "Scene":
        """Return it with a push of the station so many times as hard; 0 leaves it out.

        Raises:
            UnknownName: no such push.
        """
        pushes = {name: force for name, force in self.config.forces.items() if isinstance(force, Push)}
        push = pushes[one_of("push", name, pushes)]
        harder = push.model_copy(update={"force": tuple(size * part for part in push.force)})
        return replace(self, config=self.config.model_copy(update={"forces": {**self.config.forces, name: harder}}))

    def write(self, folder: Path) -> None:
        """Write ``station.yaml``, and ``gait.yaml`` or ``program.yaml`` where there is one.

        Raises:
            OutputError: the folder does not take them.
        """
        written_at_once(folder / "station.yaml", station_yaml(self.config))
        if self.program is not None:
            self.program.save(folder / "program.yaml")
        if self.told:
            written_at_once(folder / "gait.yaml", yaml.safe_dump(dict(self.told), sort_keys=False))


def of_station(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of some changes that are of the station."""
    return {key: value for key, value in overrides.items() if key.partition(".")[0] not in (GAIT, PROGRAM, ENGINE)}


def beside(overrides: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return changes in which the file of a program that lies in a folder is named in full."""
    file = _section(overrides, PROGRAM).get("file")
    found = folder / str(file)
    return {**overrides, "program.file": str(found.resolve())} if file and found.is_file() else dict(overrides)


def _section(overrides: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the keys of a section beside the station's, without its name before them."""
    found: dict[str, Any] = {}
    for key, value in overrides.items():
        if key == name and isinstance(value, Mapping):
            found |= value
        elif key.startswith(f"{name}."):
            found[key.partition(".")[2]] = value
        elif key == name:
            found["name" if name == GAIT else "file"] = value
    return found


@lru_cache(maxsize=4)
def _motion(robot_file: str, asked: str) -> JointMotion:
    """Plan a gait, which takes about as long as its run: once for all conditions under which it is tried."""
    robot, keys = load_robot_file(Path(robot_file)), json.loads(asked)
    known = {**gaits_of(robot, steps=True), **gaits_of(robot, steps=False)}
    name = keys.pop("name", next(iter(known)))
    if name not in known:
        raise UnknownName(f"gait of {robot.name}", name, known)
    section, gait = known[name]
    sizes = [keys.pop("steps", _STEPS)] if section.steps else []
    scaled = {"amplitude": keys.pop("amplitude", 1.0)} if section.steps else {}
    content = gait.model_dump(exclude_unset=True)
    for key, value in keys.items():
        _put(content, key, value, f"gait {name}")
    validated(type(gait), content, f"gait {name}")
    changed = {key.partition(".")[0] for key in keys}
    return section.plan(robot, *sizes, name, **scaled, **{key: content[key] for key in changed})


def _program(keys: Mapping[str, Any]) -> Program:
    if "file" not in keys:
        raise InvalidConfig(PROGRAM, "file", "this key is needed: the YAML file of the program")
    file = Path(str(keys["file"]))
    content = read_yaml(file)
    for key, value in keys.items():
        if key != "file":
            _put(content, key, value, file)
    return validated(Program, content, file)


def _put(content: Any, key: str, value: Any, where: Path | str) -> None:
    """Set what stands under a dotted key; numbers are places in lists."""
    *way, last = key.split(".")
    for part in way:
        known = isinstance(content, dict)
        content = content.setdefault(part, {}) if known else content[_place(content, part, key, where)]
    content[last if isinstance(content, dict) else _place(content, last, key, where)] = value


def _place(content: Any, place: str, key: str, where: Path | str) -> int:
    """Return a place in a list, checked."""
    if not isinstance(content, list):
        raise InvalidConfig(where, key, f"has no key '{place}': there stands {quoted(content)}")
    if not place.isdigit() or int(place) >= len(content):
        raise InvalidConfig(where, key, f"has no place '{place}'; those there are 0 to {len(content) - 1}")
    return int(place)
