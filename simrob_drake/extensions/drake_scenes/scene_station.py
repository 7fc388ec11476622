"""Scenes of Drake as stations: robots, pieces, contact and solver."""

import xml.etree.ElementTree as ET
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.multibody.parsing import GetScopedFrameByName

from simrob_drake.base.files import PIECE_FILE, ROBOT_FILE
from simrob_drake.base.frames import pose_from_transform
from simrob_drake.base.messages import join_texts, message
from simrob_drake.extensions.drake_scenes.drivers import DrivenRobot, servo_section
from simrob_drake.extensions.drake_scenes.mesh_copies import MeshCopies
from simrob_drake.extensions.drake_scenes.piece_writing import PieceWriter
from simrob_drake.extensions.drake_scenes.plant_parts import Connection, PlantGroup, plant_groups
from simrob_drake.extensions.drake_scenes.scene_files import DrakeScene
from simrob_drake.extensions.drake_scenes.tagged import yaml_text
from simrob_drake.extensions.drake_scenes.urdf_writing import group_element
from simrob_drake.importer.gains import gains_of
from simrob_drake.importer.named_robots import read_described_robot
from simrob_drake.parts.resolved import WORLD
from simrob_drake.robots.axis_map import PRISMATIC
from simrob_drake.robots.bodies import tool_links
from simrob_drake.robots.imports import ImportReport
from simrob_drake.stations.solver_config import CONTINUOUS_SCHEMES, DISCRETE_SCHEMES

_AMPLE_EFFORT = 1e6
"""Effort of a motor that the scene does not limit [N·m or N]: more than any motor of a robot has."""
_LONG_STROKE = 1e3
"""Limit of a joint that slides, if the scene has none [m]."""
_FLOOR_SIZE = 20.0
"""Length of a side of the floor that stands for a half-space [m]."""


@dataclass
class SceneStation:
    """A station that is made of a scene.

    Attributes:
        sections: content of the station's file. Files are relative to the folder.
        report: what became of the parts of the scene.
    """

    sections: dict[str, Any]
    report: ImportReport = field(default_factory=lambda: ImportReport(Path()))


def write_station(scene: DrakeScene, folder: Path) -> SceneStation:
    """Write the robots and pieces of a scene, and make the sections of its station.

    Args:
        scene: the scene.
        folder: folder that gets one folder for each robot and each piece.

    Raises:
        SimrobError: the scene has a joint or a mesh that no station has.
    """
    return _Writer(scene, folder).write()


class _Writer:
    """Makes the station of one scene."""

    def __init__(self, scene: DrakeScene, folder: Path) -> None:
        """Begin with a scene and an empty folder."""
        self._scene = scene
        self._folder = folder
        self._report = ImportReport(scene.file)
        self._sections: dict[str, Any] = {"robots": {}, "pieces": {}}
        self._has_contact = False

    def write(self) -> SceneStation:
        """Write all files, and return the sections of the station."""
        for warning in self._scene.warnings:
            self._report.add(
                "read", "", message("drake_scenes.drake_warns", "Drake warns: {text}", text=warning)
            )
        groups = plant_groups(self._scene.plant, self._scene.scene_graph, without=frozenset())
        for group in groups:
            self._has_contact |= any(
                shape.contact is not None for link in group.links for shape in link.shapes
            )
            if group.is_robot:
                self._add_robot(group)
            else:
                self._add_piece(group)
        self._add_settings()
        self._add_cameras(groups)
        self._report_drivers()
        sections = {key: value for key, value in self._sections.items() if value != {}}
        return SceneStation(sections, self._report)

    def _copies(self, name: str) -> tuple[Path, MeshCopies]:
        """Make the folder of a robot or a piece, for the copies of its meshes, too."""
        place = self._folder / name
        place.mkdir(parents=True)
        return place, MeshCopies(place, lambda mesh: self._scene.border.check(mesh, name))

    def _add_robot(self, group: PlantGroup) -> None:
        """Write the files of a robot, and add its section.

        Joints that nothing drives lose their motors and are passive.
        """
        name = group.name
        place, meshes = self._copies(name)
        passive = []
        for joint in group.moving_joints:
            if not self._is_driven(joint):
                passive.append(joint.name)
                joint.motor = None
        self._make_finite(group)

        def on_lost(link: str, shape: str) -> None:
            """Report a shape that a URDF does not have."""
            self._report.add(
                "lost",
                name,
                message("drake_scenes.no_shape", "{link}: a {shape}", link=link, shape=shape),
            )

        element = group_element(group, meshes, on_lost)
        ET.indent(element)
        (place / f"{name}.urdf").write_text(
            ET.tostring(element, encoding="unicode") + "\n", encoding="utf-8"
        )
        described: dict[str, Any] = {
            "description": f"{name}, from {self._scene.file.name}",
            "urdf": f"{name}.urdf",
            "base": "floating" if group.is_free else "fixed",
            "root": group.root.name,
            "axes": [joint.name for joint in group.moving_joints],
            "tools": {tool: tool for tool in tool_links(element)},
        }
        if passive:
            described["servo"] = {"passive": passive}
        (place / ROBOT_FILE).write_text(yaml_text(described), encoding="utf-8")
        self._sections["robots"][name] = self._robot_section(group, place / ROBOT_FILE)
        if len(group.models) > 1:
            text = message(
                "drake_scenes.models_joined",
                "the models {models} are one robot, since joints or welds connect them",
                models=join_texts(group.models),
            )
            self._report.add("read", name, text)

    def _is_driven(self, joint: Connection) -> bool:
        """Whether something drives a joint: it has an actuator and, in a scenario, its model has a driver."""
        if joint.motor is None:
            return False
        if not self._scene.is_scenario:
            return True
        driver = self._driver(joint.model)
        return driver is not None and type(driver).__name__ != "ZeroForceDriver"

    def _driver(self, model: str) -> Any:
        """Find the driver of a model. None if it has none. A driver of several models is called ``first+second``."""
        drivers = self._scene.scenario.model_drivers
        return next((driver for name, driver in drivers.items() if model in name.split("+")), None)

    def _make_finite(self, group: PlantGroup) -> None:
        """Give motors and strokes without limits large ones, since the checks of a station need numbers."""
        for joint in group.moving_joints:
            if joint.motor is not None and not np.isfinite(joint.motor.effort):
                joint.motor.effort = _AMPLE_EFFORT
                text = message(
                    "drake_scenes.no_effort_limit",
                    "its motor has no limit of effort; it gets {effort:g} N·m or N",
                    effort=_AMPLE_EFFORT,
                )
                self._report.add("defaulted", joint.name, text)
            lower, upper = joint.limits
            if joint.kind == "prismatic" or np.isfinite(joint.limits).any():
                # A joint that turns without any limit stays without one.
                joint.limits = (max(lower, -_LONG_STROKE), min(upper, _LONG_STROKE))

    def _robot_section(self, group: PlantGroup, file: Path) -> dict[str, Any]:
        """Make the section of a robot: where it stands, its posture at the start, and its servos.

        Args:
            group: the robot.
            file: its description, which is written.
        """
        model = read_described_robot(file)
        to_user = [1.0 if unit is PRISMATIC else 180.0 / np.pi for unit in model.units]
        starts = {
            joint.name: float(joint.start * factor)
            for joint, factor in zip(group.moving_joints, to_user, strict=True)
        }
        section: dict[str, Any] = {
            "model": f"{group.name}/{ROBOT_FILE}",
            "base": tuple(pose_from_transform(group.pose).tolist()),
            "initial_deg": starts,
        }
        if all(model.passive):
            return section
        first = gains_of(model)
        robot = DrivenRobot(
            group=group,
            drivers={joint.name: self._driver(joint.model) for joint in group.moving_joints},
            first_kp=dict(zip(model.axes, first.kp.tolist(), strict=True)),
            first_kd=dict(zip(model.axes, first.kd.tolist(), strict=True)),
            is_discrete=self._scene.scenario.plant_config.time_step > 0,
        )
        section["servo"] = servo_section(robot, self._report)
        return section

    def _add_piece(self, group: PlantGroup) -> None:
        """Write the file of a piece, and add its section."""
        place, meshes = self._copies(group.name)
        writer = PieceWriter(group, place, meshes, self._report)
        content = writer.content(f"{group.name}, from {self._scene.file.name}")
        if writer.half_space is not None:
            self._sections["floor"] = {"size": _FLOOR_SIZE}
        if not content.get("shapes") and not group.is_free:
            place.rmdir()  # nothing is seen or touched of it, such as of the frame that a camera is attached to
            self._report.add(
                "dropped",
                group.name,
                message("drake_scenes.no_shapes", "stands still and has no shapes"),
            )
            return
        (place / PIECE_FILE).write_text(yaml_text(content), encoding="utf-8")
        section: dict[str, Any] = {"model": f"{group.name}/{PIECE_FILE}"}
        section |= {"free": True} if group.is_free else {"parent": "world"}
        section["pose"] = tuple(pose_from_transform(group.pose).tolist())
        if writer.contact:
            section["contact"] = writer.contact
        self._sections["pieces"][group.name] = section

    def _add_settings(self) -> None:
        """Add gravity, contact, solver and duration."""
        scenario = self._scene.scenario
        self._sections["gravity"] = float(-self._scene.plant.gravity_field().gravity_vector()[2])
        plant_config = scenario.plant_config
        if self._has_contact:
            self._sections["contact"] = {
                "model": plant_config.contact_model,
                "stiction_speed": plant_config.stiction_tolerance,
            }
            text = message(
                "drake_scenes.no_self_contact",
                "links of one robot pass through each other; contact.self_collision: true changes that",
            )
            self._report.add("read", "contact", text)
        self._sections["solver"] = self._solver()
        duration = min(scenario.simulation_duration, scenario.scenario_duration)
        if np.isfinite(duration):
            self._sections["duration"] = float(duration)

    def _solver(self) -> dict[str, Any]:
        """Make the section ``solver``."""
        plant_config = self._scene.scenario.plant_config
        simulator = self._scene.scenario.simulator_config
        if plant_config.time_step > 0:
            return {
                "kind": "discrete",
                "time_step": float(plant_config.time_step),
                "scheme": self._scheme(
                    plant_config.discrete_contact_approximation, DISCRETE_SCHEMES, "lagged"
                ),
            }
        return {
            "kind": "continuous",
            "scheme": self._scheme(simulator.integration_scheme, CONTINUOUS_SCHEMES, "radau3"),
            "accuracy": float(simulator.accuracy),
            "max_step": float(simulator.max_step_size),
            "error_control": bool(simulator.use_error_control),
        }

    def _scheme(self, scheme: str, known: Collection[str], default: str) -> str:
        """Return a scheme of the scene if stations have it, or a default, which is reported."""
        if scheme in known:
            return scheme
        text = message(
            "drake_scenes.other_scheme",
            "{scheme}: {ours} takes its place",
            scheme=scheme,
            ours=default,
        )
        self._report.add("approximated", "solver", text)
        return default

    def _add_cameras(self, groups: list[PlantGroup]) -> None:
        """Add the cameras as sensors. Images of labels and messages over LCM have no counterpart in a station."""
        links = {link.index: (group, link) for group in groups for link in group.links}
        for name, camera in self._scene.scenario.cameras.items():
            parent = GetScopedFrameByName(self._scene.plant, camera.X_PB.base_frame or "world")
            pose = parent.GetFixedPoseInBodyFrame() @ camera.X_PB.GetDeterministicValue()
            pose = pose @ camera.X_BC.GetDeterministicValue()
            group, link = links.get(int(parent.body().index()), (None, None))
            frame = WORLD
            if group is not None and link is not None and group.is_robot:
                frame = link.name
                pose = link.body_pose @ pose
            elif group is not None:
                context = self._scene.plant.CreateDefaultContext()
                pose = self._scene.plant.EvalBodyPoseInWorld(context, parent.body()) @ pose
            if group is not None and group.is_free and not group.is_robot:
                text = message(
                    "drake_scenes.camera_on_free_piece", "stands still where its free piece starts"
                )
                self._report.add("approximated", f"cameras.{name}", text)
            opening = 2 * np.arctan(camera.height / (2 * camera.focal_y()))
            self._sections.setdefault("sensors", {})[name] = {
                "kind": "camera",
                "frame": frame,
                "pose": tuple(pose_from_transform(pose).tolist()),
                "rate": float(camera.fps),
                "width": int(camera.width),
                "height": int(camera.height),
                "opening_deg": float(np.rad2deg(opening)),
                "near": float(camera.z_near),
                "far": float(camera.z_far),
            }

    def _report_drivers(self) -> None:
        """Report the drivers whose model the scene does not have."""
        known = {
            self._scene.plant.GetModelInstanceName(info.model_instance)
            for info in self._scene.models
        }
        for model in self._scene.scenario.model_drivers:
            # The driver `arm+gripper` has two models.
            for part in model.split("+"):
                if part not in known:
                    text = message(
                        "drake_scenes.driver_without_model", "there is no model of this name"
                    )
                    self._report.add("dropped", f"model_drivers.{model}", text)
