"""Scenes of the tests: those of the examples, and what plain Drake says about them."""

from pathlib import Path
from typing import TypeVar

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

Name = TypeVar("Name", str, tuple[str, str])

SCENES = Path(__file__).parents[3] / "examples" / "drake" / "scenes"
"""Folder with the scenes of the examples, which is also a package of ROS."""


class PlainPlant:
    """A plant that plain Drake makes of a file, without any code of this package."""

    def __init__(self, file: Path, packages: Path, *, time_step: float = 0.001) -> None:
        """Load a file.

        Args:
            file: model directives, a URDF or an SDF file.
            packages: folder with the packages that it names.
            time_step: length of a step [s].
        """
        self.builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(self.builder, time_step)
        parser = Parser(self.plant, self.scene_graph)
        parser.package_map().PopulateFromFolder(str(packages))
        parser.AddModels(str(file))
        self.plant.Finalize()


class OwnPlant:
    """The plant of a station."""

    def __init__(self, config: StationConfig) -> None:
        """Build the plant of a station."""
        self.builder = DiagramBuilder()
        self.station: StationPlant = add_plant(self.builder, resolve(config))
        self.plant = self.station.plant


def body_values(plant: MultibodyPlant) -> dict[tuple[str, str], Vector]:
    """Mass, inertia and pose of each body at the start, shape (53,), by the names of model and body."""
    context = plant.CreateDefaultContext()
    values = {}
    for index in range(1, plant.num_bodies()):
        body = plant.get_body(type(plant.world_body().index())(index))
        model = plant.GetModelInstanceName(body.model_instance()).partition("::")[0]
        inertia = body.default_spatial_inertia().CopyToFullMatrix6().ravel()
        pose = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4().ravel()
        values[model, body.name()] = np.concatenate([[body.default_mass()], inertia, pose])
    return values


def joint_values(plant: MultibodyPlant) -> dict[str, Vector]:
    """Limits, damping, start and motor of each joint that moves, shape (8,), by its name."""
    motors = {
        int(plant.get_joint_actuator(index).joint().index()): plant.get_joint_actuator(index)
        for index in plant.GetJointActuatorIndices()
    }
    values = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_velocities() != 1:
            continue
        motor = motors.get(int(index))
        values[joint.name()] = np.array(
            [
                joint.position_lower_limits()[0],
                joint.position_upper_limits()[0],
                joint.velocity_upper_limits()[0],
                joint.acceleration_upper_limits()[0],
                joint.default_damping_vector()[0],
                joint.default_positions()[0],
                0.0 if motor is None else motor.effort_limit(),
                0.0 if motor is None else motor.default_reflected_inertia(),
            ]
        )
    return values


def largest_difference(first: dict[Name, Vector], second: dict[Name, Vector]) -> float:
    """Largest difference of values with the same name. Infinite limits count as equal."""
    assert first.keys() == second.keys()
    differences = [0.0]
    for name, values in first.items():
        unequal = values != second[name]
        differences += abs(values[unequal] - second[name][unequal]).tolist()
    return max(differences)
