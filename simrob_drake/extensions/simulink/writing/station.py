"""Put robots, pieces, contacts, servos and references together: the files of a station."""

from dataclasses import replace
from math import isfinite
from os.path import commonprefix
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ElementTree, indent

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.files import PIECE_FILE, ROBOT_FILE
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.mechanics.bodies import PUSH
from simrob_drake.extensions.simulink.mechanics.joints import Freedom
from simrob_drake.extensions.simulink.mechanics.solids import SolidBody
from simrob_drake.extensions.simulink.mechanics.trees import Tree
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.signals.forms import Form, Term, closure, of_time, terms_of
from simrob_drake.extensions.simulink.signals.laws import Law
from simrob_drake.extensions.simulink.simulink_model import SimulinkModel
from simrob_drake.extensions.simulink.writing.flow import Sum, flows_of, frame_sensors
from simrob_drake.extensions.simulink.writing.references import (
    JointMotions,
    coupling_sections,
    servo_section,
    start_state,
    stop_section,
)
from simrob_drake.extensions.simulink.writing.touching import (
    StationFiles,
    contact_section,
    distance_sensors,
    feet_of,
    read_touching,
)
from simrob_drake.extensions.simulink.writing.urdf import (
    RobotFile,
    UniqueNames,
    UrdfWriter,
    as_yaml,
    plain,
    pose_list,
)
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import joint_limits, name_of

_INSIDE = 1e-8  # how far within its limits a joint starts at least [rad or m]: files hold degrees and radians
SOLVERS: dict[str, dict[str, Any]] = {
    "arm": {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-3, "max_step": 0.1},
    "feet": {"kind": "continuous", "scheme": "cenic", "accuracy": 1e-5, "max_step": 0.02},
    "loops": {"kind": "continuous", "scheme": "radau3", "accuracy": 1e-4, "max_step": 0.01},
    # by which couplings are constraints
    "points": {
        "kind": "discrete",
        "scheme": "sap",
        "time_step": 1e-4,
    },
    # by forces that jump: contact in signals
    "struck": {
        "kind": "discrete",
        "scheme": "sap",
        "time_step": 2e-4,
    },
    # whose joints are moved along given motions
    "walkers": {
        "kind": "discrete",
        "scheme": "sap",
        "time_step": 5e-4,
    },
    "pieces": {"kind": "continuous", "scheme": "runge_kutta3", "accuracy": 3e-4, "max_step": 0.02},
}
_OF_SERVOS = [f"{which}_error_{unit}" for which in ("final", "largest") for unit in ("deg", "m")]
"""Bounds of a verdict on servos: joints without one, and springs that stand as such, are not asked to be at rest."""


class StationWriter:
    """Writes one model into one folder."""

    def __init__(self, model: SimulinkModel, folder: Path) -> None:
        self._model, self._folder = model, folder
        self._report: ImportReport = model.report
        self._names = UniqueNames(("world", "floor", "robot"))
        self._turn, gravity = _upright(model)
        self._touching = read_touching(model, self._turn)
        self._files = StationFiles(model, self._turn, gravity, self._names, self._touching)
        self._moved = False

    def write(self) -> StationFiles:
        """Write everything, and return what there is."""
        name = plain(self._model.path.stem)
        mechanisms = _together(
            self._weighing([tree for tree in self._model.trees if tree.branches])
        )
        homes = {tree: _home(tree) for tree in mechanisms}
        base_solids = self._share_world(mechanisms, homes)
        for tree in mechanisms:
            robot_name = self._names.give(homes[tree].partition("/")[0] or name)
            writer = UrdfWriter(self._folder / robot_name, self._report, self._names)
            self._files.robots[robot_name] = writer.robot(
                robot_name, tree, base_solids.get(tree, [])
            )
        for robot in self._files.robots.values():
            robot.axes = dict(sorted(robot.axes.items(), key=lambda entry: self._place(entry[0])))
        pieces = self._pieces(base_solids)
        if not self._files.robots and not any(entry.get("free") for entry in pieces.values()):
            self._report.add(
                "dropped",
                name,
                message(
                    "simulink.only_pieces",
                    "the station: everything stands fixed, so only pieces are written",
                ),
            )
            return self._files
        self._files.content = self._station(name, pieces)
        header = f"# From the Simulink model {self._model.path.name}; report.json tells what became of each block.\n"
        (self._folder / f"{name}.yaml").write_text(
            header + as_yaml(self._files.content), encoding="utf-8"
        )
        return self._files

    def _share_world(
        self, trees: list[Tree], homes: dict[Tree, str]
    ) -> dict[Tree, list[SolidBody]]:
        """Return which solids of the world belong to a robot's base: those drawn in its subsystem."""
        shared: dict[Tree, list[SolidBody]] = {}
        world = self._model.world
        grounded = [tree for tree in trees if tree.root is world and homes[tree]]
        for solid in world.solids if world else []:
            owner = next(
                (tree for tree in grounded if solid.node.path.startswith(f"{homes[tree]}/")), None
            )
            if owner is not None and solid.node not in self._touching.colliding:
                shared.setdefault(owner, []).append(solid)
        return shared

    def _pieces(self, base_solids: dict[Tree, list[SolidBody]]) -> dict[str, dict[str, Any]]:
        taken = {solid.node for solids in base_solids.values() for solid in solids}
        pieces: dict[str, dict[str, Any]] = {}
        groups: dict[str, list[SolidBody]] = {}
        for solid in [
            *(self._model.world.solids if self._model.world else []),
            *self._touching.slabs.values(),
        ]:
            if solid.node not in taken:
                groups.setdefault(solid.node.path.partition("/")[0], []).append(solid)
        for group, solids in groups.items():
            entry = {"parent": "world", "pose": pose_list(self._turn)}
            self._files.groups[group] = self._piece(pieces, group, solids, entry)
        for tree in self._model.trees:
            if not (tree.branches or tree.root.grounded) and tree.root.solids:
                path = tree.root.solids[0].node.path.partition("/")[0]
                solids = [
                    replace(solid, pose=tree.frame.inverse() @ solid.pose)
                    for solid in tree.root.solids
                ]
                if name := self._piece(
                    pieces, path, solids, {"free": True, "pose": pose_list(self._turn @ tree.base)}
                ):
                    self._files.free[tree] = name
        return pieces

    def _piece(
        self, pieces: dict[str, Any], path: str, solids: list[SolidBody], entry: dict[str, Any]
    ) -> str:
        name = self._names.give(path)
        fixed = "free" not in entry
        if not fixed and sum(solid.weight.mass for solid in solids) <= 0:
            self._report.add(
                "dropped",
                path,
                message(
                    "simulink.free_and_weightless", "is free and weighs nothing: it cannot move"
                ),
            )
            return ""
        writer = UrdfWriter(self._folder / name, self._report, self._names)
        if not writer.piece(name, solids, self._touching.colliding, weighs=not fixed):
            return ""
        pieces[name] = {"model": f"{name}/{PIECE_FILE}", **entry}
        self._files.pieces.append(name)
        if not any(solid.node in self._touching.colliding for solid in solids) and not fixed:
            self._report.add(
                "read",
                path,
                message("simulink.falls_freely", "falls freely: nothing holds or touches it"),
            )
        return name

    def _station(self, name: str, pieces: dict[str, Any]) -> dict[str, Any]:
        kinematic = self._moved = self._kinematic()
        for piece, entry in pieces.items() if kinematic else ():
            if entry.pop("free", False):
                entry["parent"] = "world"
                self._report.add(
                    "approximated",
                    piece,
                    message(
                        "simulink.stands_fixed",
                        "stands fixed: nothing falls in a kinematic station",
                    ),
                )
        content: dict[str, Any] = {
            "description": f"{name}, from a Simulink model",
            "mode": "kinematic" if kinematic else "dynamic",
        }
        robots = {
            key: self._robot(key, robot, kinematic) for key, robot in self._files.robots.items()
        }
        content |= _robot_sections(robots)
        if not kinematic and (prescribed := self._prescribed()):
            content["prescribed"] = prescribed
        if pieces:
            content["pieces"] = pieces
        if self._touching.floor:
            content["floor"] = {"size": 10, **self._terrain(name)}
        sensors, monitors = dict[str, Any](), dict[str, Any]()
        if self._touching.ends and not kinematic:
            content["contact"] = contact_section(self._files)
            sensors, monitors = distance_sensors(self._files)
        seen, measured = frame_sensors(self._files)
        parts = {"sensors": sensors | seen, "monitors": monitors}
        content |= {key: part for key, part in parts.items() if part}
        content["gravity"] = self._files.gravity
        if not kinematic and any(robot.pushed for robot in self._files.robots.values()):
            content["inputs"] = self._pushes()
        for push in self._model.pushes if kinematic else ():
            push.node.note(
                "dropped",
                message(
                    "simulink.force_in_kinematic",
                    "a force, in a station without forces: what moves is prescribed",
                ),
            )
        content |= coupling_sections(self._files, kinematic=kinematic)
        content |= {} if kinematic else self._dynamics(sensors | seen, measured)
        return {**content, "duration": self._model.duration}

    def _terrain(self, name: str) -> dict[str, Any]:
        if self._touching.heights is None:
            return {}
        file = self._folder / f"{name}_terrain.csv"
        np.savetxt(file, self._touching.heights, fmt="%.6g", delimiter=",")
        return {"terrain": {**self._touching.terrain, "file": file.name}}

    def _pushes(self) -> list[str]:
        """Return the ports of what External Force and Torque blocks apply; a force unless they tell."""
        driven = {push.node for push in self._model.pushes}
        pushes = [
            node for node in self._model.expanded.nodes if node.kind == PUSH and node not in driven
        ]
        kinds = [kind for kind in ("Force", "Torque") if
                 any(node.is_on(f"Enable{kind}{axis}") for node in pushes for axis in ("", "X", "Y", "Z"))]  # fmt: skip
        return [f"external_{kind.lower()}" for kind in kinds or ["Force"]]

    def _dynamics(self, sensors: dict[str, Any], measured: dict[Term, Sum]) -> dict[str, Any]:
        """Return what only a station of torques has: its solver, laws that are no servos, and speeds at the start."""
        flows = flows_of(self._files, sensors, measured)
        content: dict[str, Any] = {"controllers": flows} if flows else {}
        solver = self._solver()
        if "accuracy" in solver and (flows or any(map(_is_moved, self._files.robots.values()))):
            # limits of a law are found within a step
            longest = 0.02 if self._touching.ends else 0.005
            solver = {**solver, "accuracy": min(solver["accuracy"], 1e-4), "max_step": longest}
        content["solver"] = solver
        freedoms = [freedom for robot in self._files.robots.values() for freedom in robot.axes]
        servos = {freedom: law.kp for freedom in freedoms if (law := self._law(freedom)).kp}
        if freedoms and all(kp == freedom.stiffness for freedom, kp in servos.items()):
            content["verdict"] = dict.fromkeys(_OF_SERVOS, "none")
        starts = {name: self._starts(robot) for name, robot in self._files.robots.items()}
        if (state := start_state(self._files, starts)) is not None:
            file = self._folder / f"{plain(self._model.path.stem)}_start.json"
            file.write_text(state.to_json() + "\n", encoding="utf-8")
            content["start"] = file.name
        return content

    def _kinematic(self) -> bool:
        """Tell whether the motion is the input, or nothing weighs enough to be moved by torque."""
        driven = {freedom.driven for robot in self._files.robots.values() for freedom in robot.axes}
        robots = [robot for robot in self._files.robots.values() if robot.weightless]
        stand = all(robot.tree.root.grounded for robot in self._files.robots.values())
        if driven == {"motion"} and stand and not self._files.free:
            return True
        bound = any(
            robot.tree.closings or robot.tree.gears or not robot.tree.root.grounded
            for robot in robots
        )
        if robots and (
            bound
            or not (self._files.free or any(robot.mass for robot in self._files.robots.values()))
        ):
            names = [name for robot in robots for name in robot.weightless.values()]
            text = message(
                "simulink.weightless_links",
                "kinematic, nothing moves by forces: these links weigh nothing: {names}",
                names=", ".join(names[:5]),
            )
            self._report.add("lost", message("simulink.motion_by_forces", "motion by forces"), text)
            return True
        for branch in (
            branch
            for robot in robots
            for branch in robot.tree.branches
            if branch.body in robot.weightless
        ):
            branch.link.joint.node.note(
                "lost",
                message(
                    "simulink.held_where_it_starts",
                    "what it moves weighs nothing: it is held where it starts",
                ),
            )
            for freedom in branch.freedoms:
                freedom.driven = "motion"
                self._model.laws.pop(freedom, None)
        return False

    def _weighing(self, trees: list[Tree]) -> list[Tree]:
        """Return trees without those that nothing holds and that weigh nothing, if others do."""
        kept = [tree for tree in trees if tree.root.grounded or _weighs(tree)]
        for tree in (tree for tree in trees if any(map(_weighs, kept)) and tree not in kept):
            for branch in tree.branches:
                branch.link.joint.node.note(
                    "lost",
                    message(
                        "simulink.weightless_left_out",
                        "nothing holds what it joins, which weighs nothing: left out",
                    ),
                )
        return kept if any(map(_weighs, kept)) else trees

    def _robot(self, name: str, robot: RobotFile, kinematic: bool) -> dict[str, Any]:
        folder = self._folder / name
        indent(robot.element)
        ElementTree(robot.element).write(
            folder / f"{name}.urdf", encoding="unicode", xml_declaration=True
        )
        floating = not robot.tree.root.grounded
        described: dict[str, Any] = {
            "description": f"{name}, from the Simulink model {self._model.path.stem}",
            "urdf": f"{name}.urdf",
            "base": "floating" if floating else "fixed",
            "root": robot.links[robot.tree.root],
            "axes": list(robot.axes.values()),
        }
        rotors = {
            axis: float(f"{self._law(freedom).rotor:.12g}") for freedom, axis in robot.axes.items()
        }
        drives = {"rotor_inertia": rotors} if any(rotors.values()) else {}
        parts = {"drives": drives, "tools": robot.tools, "feet": feet_of(robot, self._files)}
        described |= {key: part for key, part in parts.items() if part}
        (folder / ROBOT_FILE).write_text(as_yaml(described), encoding="utf-8")
        start = self._starts(robot)
        entry: dict[str, Any] = {"model": f"{name}/{ROBOT_FILE}"}
        if robot.pushed:
            entry["tcp"] = robot.pushed
        base = self._turn @ robot.tree.base
        if not base.IsNearlyIdentity(1e-12):
            entry["base"] = pose_list(base)
        degrees = {
            axis: np.rad2deg(start[axis]) if one.turns else start[axis]
            for one, axis in robot.axes.items()
        }
        # The robot has no home, so an axis at zero is named only where its range excludes zero.
        ranges = {name_of(joint): joint_limits(joint) for joint in robot.element.iterfind("joint")}
        named = [
            axis
            for axis, value in degrees.items()
            if value or not ranges[axis][0] <= 0.0 <= ranges[axis][1]
        ]
        if named:
            entry["initial_deg"] = {axis: float(f"{degrees[axis]:.12g}") for axis in named}
        laws = {freedom: self._law(freedom) for freedom in robot.axes}
        for freedom, law in laws.items():
            self._tell(name, robot.axes[freedom], freedom, law, kinematic=kinematic)
        if not kinematic:
            entry["servo"] = servo_section(robot, laws)
            entry |= {"joint_stops": stops} if (stops := stop_section(robot)) else {}
        forms = {freedom: law.reference for freedom, law in laws.items()}
        file = self._folder / f"{name}_reference.csv"
        entry["reference"] = JointMotions(self._files, robot.axes, forms, start, file).reference()
        if kinematic and any(freedom.start_speed for freedom in robot.axes):
            self._report.add(
                "dropped",
                name,
                message(
                    "simulink.speeds_at_start",
                    "speeds at the start: what moves it is its reference",
                ),
            )
        return entry

    def _prescribed(self) -> dict[str, Any]:
        """Return the motions that are inputs of joints, beside which all else moves by forces."""
        sections: dict[str, Any] = {}
        for name, robot in self._files.robots.items():
            axes = {
                freedom: axis for freedom, axis in robot.axes.items() if freedom.driven == "motion"
            }
            forms = {freedom: self._model.law_of(freedom).reference for freedom in axes}
            file = self._folder / f"{name}_prescribed.csv"
            found = JointMotions(self._files, axes, forms, self._starts(robot), file).prescribed()
            sections |= {
                f"{self._files.prefix(name)}{axis}": section for axis, section in found.items()
            }
        return sections

    def _starts(self, robot: RobotFile) -> dict[str, float]:
        starts = {}
        for freedom, axis in robot.axes.items():
            desired = freedom.start or 0.0
            starts[axis] = taken = float(
                np.clip(desired, freedom.lower + _INSIDE, freedom.upper - _INSIDE)
            )
            if abs(taken - desired) > 2 * _INSIDE:
                text = message(
                    "simulink.start_out_of_limits",
                    "starts at {desired:.4g}, out of its limits: at {taken:.4g}",
                    desired=desired,
                    taken=taken,
                )
                self._report.add("repaired", freedom.name, text)
        return starts

    def _law(self, freedom: Freedom) -> Law:
        law = self._model.law_of(freedom)
        if freedom.driven == "motion":
            return law if self._moved else Law()
        if freedom.stiffness and law.is_idle:
            self._report.add(
                "read",
                freedom.name,
                message(
                    "simulink.spring_is_kp",
                    "its spring of {stiffness:g} is its servo's kp",
                    stiffness=freedom.stiffness,
                ),
            )
            return Law(kp=freedom.stiffness, reference=freedom.rest)
        return law

    def _tell(self, robot: str, axis: str, freedom: Freedom, law: Law, *, kinematic: bool) -> None:
        gains = {
            "kp": law.kp,
            "ki": law.ki,
            "kd": law.kd,
            "limit": law.limit if isfinite(law.limit) else 0.0,
        }
        shown = ", ".join(f"{key} {value:.6g}" for key, value in gains.items() if value)
        drive = (
            message("simulink.servo_with", "servo {gains}", gains=shown)
            if shown
            else message("simulink.no_servo", "no servo")
        )
        if terms_of(law.net):
            drive = message("simulink.driven_by_blocks", "driven by the blocks of its law")
        elif kinematic or freedom.driven == "motion":
            drive = (
                message("simulink.moved_as_reference", "moved as its reference")
                if kinematic
                else message("simulink.motion_prescribed", "its motion is prescribed")
            )
            motion = self._model.law_of(freedom).reference
            if isinstance(motion, Form) and of_time(motion):
                drive += message(
                    "simulink.for_seconds_then_holds",
                    " for {duration:g} s, and holds then",
                    duration=self._model.duration,
                )
        self._report.add(
            "read",
            freedom.name,
            message(
                "simulink.axis_of_robot",
                "axis {axis} of {robot}: {drive}",
                axis=axis,
                robot=robot,
                drive=drive,
            ),
        )

    def _place(self, freedom: Freedom) -> tuple[int, int]:
        """Return where a joint stands among the model's inputs; joints without one keep their order behind."""
        law = self._model.law_of(freedom)
        for terms in closure([law.reference or 0.0, law.net]):
            for term in terms:
                if term.kind == "input" and isinstance(term.of, Node):
                    port = term.of.text("Port", "1")
                    return int(port) if port.isdecimal() else 1, term.index
        return 10**6, 0

    def _solver(self) -> dict[str, Any]:
        robots, touches = list(self._files.robots.values()), self._touching.ends
        if any(robot.tree.closings or robot.tree.gears for robot in robots):
            loops = [robot for robot in robots if robot.tree.closings]
            points = any(
                closing.kind in ("rod", "ball")
                for robot in loops
                for closing in robot.tree.closings
            )
            # they tear at couplings
            sprung = any(freedom.stiffness for robot in loops for freedom in robot.axes)
            return SOLVERS["points" if points or sprung or touches else "loops"]
        if any(
            _is_moved(robot) and (touches or not robot.tree.root.grounded) for robot in robots
        ):  # late in cenic
            return SOLVERS["walkers"]
        if any(push.jumps for push in self._model.pushes):
            return SOLVERS["struck"]
        return SOLVERS["pieces" if not robots else "feet" if touches else "arm"]


def _home(tree: Tree) -> str:
    """Return the subsystem that all joints of a tree are in; empty for the model itself."""
    ways = [branch.link.joint.node.path.split("/")[:-1] for branch in tree.branches]
    return "/".join(commonprefix(ways))  # noqa: RUF071  # of lists it compares the parts


def _weighs(tree: Tree) -> bool:
    return any(
        solid.weight.mass > 0 for body in tree.bodies if not body.grounded for solid in body.solids
    )


def _is_moved(robot: RobotFile) -> bool:
    return any(freedom.driven == "motion" for freedom in robot.axes)


def _together(trees: list[Tree]) -> list[Tree]:
    """Return the mechanisms with those as one that stand on the world and are drawn in one subsystem."""
    merged: dict[str, Tree] = {}
    for tree in trees:
        if tree.root.grounded:
            home = tree.branches[0].link.joint.node.path.rpartition("/")[0].partition("/")[0]
            mechanism = merged.setdefault(home, Tree(tree.root))
            mechanism.branches += tree.branches
            mechanism.closings += tree.closings
            mechanism.gears |= tree.gears
    return [*merged.values(), *(tree for tree in trees if not tree.root.grounded)]


def _robot_sections(robots: dict[str, Any]) -> dict[str, Any]:
    if len(robots) != 1:
        return {"robots": robots} if robots else {}
    (robot,) = robots.values()
    return {"robot": robot} | {
        key: robot.pop(key) for key in ("servo", "joint_stops", "reference") if key in robot
    }


def _upright(model: SimulinkModel) -> tuple[RigidTransform, float]:
    """Return how the model's world is turned so that its gravity points down, and how strong that is [m/s²]."""
    vector = model.gravity
    if vector is None:
        return RigidTransform(), STANDARD_GRAVITY
    strength = float(np.linalg.norm(vector))
    if strength == 0 or np.allclose(vector / strength, [0, 0, -1]):
        return RigidTransform(), strength
    up = -vector / strength
    axis = np.cross(up, [0.0, 0.0, 1.0])
    axis = axis / length if (length := np.linalg.norm(axis)) > 1e-9 else np.array([1.0, 0.0, 0.0])
    turn = RotationMatrix(AngleAxis(float(np.arccos(np.clip(up[2], -1, 1))), axis))
    model.report.add(
        "read",
        "gravity",
        message(
            "simulink.world_is_turned",
            "points along {direction}: the world is turned to put it down",
            direction=vector.round(4).tolist(),
        ),
    )
    return RigidTransform(turn), strength
