"""Stations as files of Drake: model directives, scenarios, URDF and SDF."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import HalfSpace
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.folders import filled_at_once, written_at_once
from simrob_drake.extensions.drake_scenes.drivers import driver_entries
from simrob_drake.extensions.drake_scenes.mesh_copies import MeshCopies
from simrob_drake.extensions.drake_scenes.plant_parts import WORLD_SHAPES, PlantGroup, plant_groups
from simrob_drake.extensions.drake_scenes.sdf_writing import sdf_element
from simrob_drake.extensions.drake_scenes.tagged import Tagged, yaml_text
from simrob_drake.extensions.drake_scenes.urdf_writing import group_element, stations_element
from simrob_drake.parts.targets import FLOOR
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve
from simrob_drake.stations.solver_config import ContinuousSolver

PACKAGE_FILE = "package.xml"
"""File that makes the folder with the models a package of ROS, and so for Drake."""


def station_groups(config: StationConfig) -> list[PlantGroup]:
    """Find the robots, pieces and floor of a station in its plant, under the names that the station has for them."""
    builder = DiagramBuilder()  # owns the plant, so it is kept until the groups are read
    plant = add_plant(builder, resolve(config))
    groups = plant_groups(plant.plant, plant.scene_graph, without=plant.contact_points)
    for group in groups:
        # A robot is the model instance "<robot>::<model>" of the plant, and a piece "<piece>::<piece>".
        group.name = FLOOR if group.name == WORLD_SHAPES else group.models[0].partition("::")[0]
    return groups


def save_directives(config: StationConfig, file: Path, *, force: bool) -> list[Path]:
    """Write a station as model directives, with a folder of its models.

    Args:
        config: the station.
        file: the file to write, ``scene.dmd.yaml``. The folder next to it is called ``scene_models``.
        force: whether to replace what is there.

    Returns:
        the file and the folder.

    Raises:
        SimrobError: the station cannot be built, or the disk does not take the files.
    """
    return _save_scene(file, station_groups(config), {}, [], force=force)


def save_scenario(config: StationConfig, file: Path, *, force: bool) -> list[Path]:
    """Write a station as a scenario, with a folder of its models. Arguments, result and errors as `save_directives`."""
    drivers, remarks = driver_entries(config, resolve(config).robots)
    sections: dict[str, Any] = {"plant_config": _plant_config(config)}
    if not config.engine.has_discrete_states:
        sections["simulator_config"] = _simulator_config(config)
    sections["simulation_duration"] = config.duration
    if drivers:
        sections["model_drivers"] = drivers
    return _save_scene(file, station_groups(config), sections, remarks, force=force)


def save_urdf(config: StationConfig, file: Path, *, force: bool) -> list[Path]:
    """Write a station as one URDF file, with a folder of its meshes.

    Shapes that a URDF does not have are left out, which is the half-space of a floor alone. Arguments, result and
    errors as `save_directives`.
    """

    def element(groups: list[PlantGroup], meshes: MeshCopies) -> ET.Element:
        """Make the content of the file."""
        return stations_element(config.name, groups, meshes, lambda link, shape: None)

    return _save_model(config, file, element, force=force)


def save_sdf(config: StationConfig, file: Path, *, force: bool) -> list[Path]:
    """Write a station as one SDF world, with a folder of its meshes. Arguments, result, errors as `save_directives`."""

    def element(groups: list[PlantGroup], meshes: MeshCopies) -> ET.Element:
        """Make the content of the file."""
        return sdf_element(config.name, groups, meshes, is_world=True)

    return _save_model(config, file, element, force=force)


def _save_model(
    config: StationConfig,
    file: Path,
    element: Callable[[list[PlantGroup], MeshCopies], ET.Element],
    *,
    force: bool,
) -> list[Path]:
    """Write a station as one XML file, with a folder of its meshes if it has any.

    Args:
        config: the station.
        file: the file to write. The folder next to it has its name and ``_models``.
        element: function that makes the content of the file, and copies the meshes.
        force: whether to replace what is there.
    """
    groups = station_groups(config)
    folder = _models_folder(file)
    with filled_at_once(folder, marker=PACKAGE_FILE, force=force) as work:
        content = element(groups, MeshCopies(work))
        _write_package(work, folder.name)
    for mesh in content.iter("mesh"):
        _prefix_mesh(mesh, folder.name)
    written_at_once(file, _xml(content))
    return [file, folder]


def _save_scene(
    file: Path,
    groups: list[PlantGroup],
    sections: Mapping[str, Any],
    remarks: list[str],
    *,
    force: bool,
) -> list[Path]:
    """Write a file of directives, with a folder of its models.

    Args:
        file: the file to write.
        groups: robots and pieces.
        sections: further sections of the file.
        remarks: what the file cannot express, for its first lines.
        force: whether to replace what is there.
    """
    folder = _models_folder(file)
    directives = []
    with filled_at_once(folder, marker=PACKAGE_FILE, force=force) as work:
        for group in groups:
            model = _write_group(group, work)
            directives += _directives(group, f"package://{folder.name}/{group.name}/{model}")
        _write_package(work, folder.name)
    lines = [
        f"# Models: the package {folder.name}, the folder next to this file.",
        *(f"# {line}" for line in remarks),
    ]
    content = yaml_text({"directives": directives, **sections})
    written_at_once(file, "\n".join(lines) + "\n" + content)
    return [file, folder]


def _write_group(group: PlantGroup, folder: Path) -> str:
    """Write a group as a model with a folder of its own. Returns the name of the file in that folder."""
    place = folder / group.name
    place.mkdir()
    meshes = MeshCopies(place)
    has_half_space = any(
        isinstance(shape.shape, HalfSpace) for link in group.links for shape in link.shapes
    )
    if has_half_space:
        element, name = (
            sdf_element(group.name, [group], meshes, is_world=False),
            f"{group.name}.sdf",
        )
    else:
        element, name = group_element(group, meshes, lambda link, shape: None), f"{group.name}.urdf"
    (place / name).write_text(_xml(element), encoding="utf-8")
    return name


def _directives(group: PlantGroup, uri: str) -> list[dict[str, Any]]:
    """Make the directives that add a group: the model with its positions, and the weld that holds it.

    Args:
        group: a robot or a piece.
        uri: URI of its model.
    """
    model: dict[str, Any] = {"name": group.name, "file": uri}
    starts = {joint.name: (joint.start,) for joint in group.moving_joints}
    if starts:
        model["default_joint_positions"] = starts
    if group.is_free:
        model["default_free_body_pose"] = {group.root.name: _transform(group.pose)}
        return [{"add_model": model}]
    weld = {
        "parent": "world",
        "child": f"{group.name}::{group.root.name}",
        "X_PC": _transform(group.pose),
    }
    return [{"add_model": model}, {"add_weld": weld}]


def _transform(pose: RigidTransform) -> dict[str, Any]:
    """Describe a pose as Drake's files do: translation [m], and roll, pitch and yaw [deg]."""
    angles = np.rad2deg(RollPitchYaw(pose.rotation()).vector())
    return {
        "translation": tuple(pose.translation().tolist()),
        "rotation": Tagged("Rpy", {"deg": tuple(angles.tolist())}),
    }


def _plant_config(config: StationConfig) -> dict[str, Any]:
    """Make the section ``plant_config`` of a scenario."""
    engine = config.engine
    section: dict[str, Any] = {"time_step": engine.time_step}
    if engine.has_discrete_states:
        section["discrete_contact_approximation"] = engine.name
    section["contact_model"] = config.contact.model if config.contact else "point"
    if config.contact is not None:
        section["stiction_tolerance"] = config.contact.stiction_speed
    return section


def _simulator_config(config: StationConfig) -> dict[str, Any]:
    """Make the section ``simulator_config`` of a scenario, for a station of continuous time."""
    solver = config.solver
    if not isinstance(
        solver, ContinuousSolver
    ):  # of another engine, whose steps Drake does not make
        return {}
    return {
        "integration_scheme": solver.scheme,
        "max_step_size": solver.max_step,
        "accuracy": solver.accuracy,
        "use_error_control": solver.error_control,
    }


def _models_folder(file: Path) -> Path:
    """Find the folder for the models next to a file: ``scene_models`` next to ``scene.dmd.yaml``."""
    return file.with_name(f"{file.name.partition('.')[0]}_models")


def _write_package(folder: Path, name: str) -> None:
    """Write the manifest that makes a folder a package."""
    package = ET.Element("package", format="2")
    ET.SubElement(package, "name").text = name
    (folder / PACKAGE_FILE).write_text(_xml(package), encoding="utf-8")


def _prefix_mesh(mesh: ET.Element, folder: str) -> None:
    """Let a mesh be named from the folder above that of its copy, in the attribute of a URDF or the element of SDF."""
    uri = mesh.find("uri")
    if uri is None:
        mesh.set("filename", f"{folder}/{mesh.get('filename')}")
    else:
        uri.text = f"{folder}/{uri.text}"


def _xml(element: ET.Element) -> str:
    """Write an element as the text of a file."""
    ET.indent(element)
    # SDF files use Drake's prefix without declaring it, and so do we where the names have it already.
    return '<?xml version="1.0"?>\n' + ET.tostring(element, encoding="unicode") + "\n"
