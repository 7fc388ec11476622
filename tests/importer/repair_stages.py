"""The stages that repair structure and physics, in their order, for tests: from a text to a robot and its report."""

import xml.etree.ElementTree as ET
from pathlib import Path

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.importer.reading.source import read_source
from simrob_drake.importer.repairs.base import choose_base
from simrob_drake.importer.repairs.drives import repair_drives
from simrob_drake.importer.repairs.inertias import repair_inertias
from simrob_drake.importer.repairs.joints import repair_joints
from simrob_drake.importer.repairs.materials import repair_materials
from simrob_drake.importer.repairs.structure import repair_structure
from simrob_drake.robots.imports import ImportOptions, ImportReport
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes
from simrob_drake.robots.urdf_check import check_urdf

INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
TIP = '<link name="tip"/>'
FLANGE = '<joint name="flange" type="fixed"><parent link="upper"/><child link="tip"/><origin xyz="0 0 0.3"/></joint>'
DRIVE = (
    '<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>'
    '<joint name="shoulder"/><actuator name="motor"/></transmission>'
)
END = "</robot>"
ARM = f"""<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"><visual><geometry><box size="0.1 0.1 0.2"/></geometry><material name="red"/></visual></link>
  <link name="upper">
    <inertial><origin xyz="0 0 0.1"/><mass value="1"/>{INERTIA}</inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.3"/></geometry></collision>
  </link>
  {TIP}
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.2" rpy="0 0 0"/><axis xyz="0 1 0"/>{LIMIT}<dynamics damping="0.1"/></joint>
  {FLANGE}
  {DRIVE}
{END}
"""
"""A robot that needs no repair; a test puts one defect into it."""


def joint(name: str, parent: str, child: str, kind: str = "fixed", inside: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def with_defect(good: str, bad: str, text: str = ARM) -> str:
    assert good in text
    return text.replace(good, bad, 1)


def repair(robot: ET.Element, folder: Path, options: ImportOptions, report: ImportReport) -> str:
    """Do all stages but that of the shapes, and return the base."""
    repair_structure(robot, options, report)
    repair_materials(robot, report)
    repair_joints(robot, options, report)
    repair_inertias(robot, folder, options, report)
    repair_drives(robot, options, report)
    return choose_base(robot, options, report)


class Repaired:
    """A text after all stages: checked, loaded by Drake, and repaired again without any change."""

    def __init__(self, text: str, folder: Path, options: ImportOptions | None = None) -> None:
        options = options or ImportOptions()
        source = folder / "arm.urdf"
        source.write_text(text, encoding="utf-8")
        self.report = ImportReport(source)
        self.robot = read_source(source, self.report)
        self.base = repair(self.robot, folder, options, self.report)
        check_urdf(self.robot, source)
        self.plant = loaded(self.robot, folder)
        self._repair_again(folder, options)

    def _repair_again(self, folder: Path, options: ImportOptions) -> None:
        text = ET.tostring(self.robot, encoding="unicode")
        again = folder / "again.urdf"
        again.write_text(text, encoding="utf-8")
        report = ImportReport(again)
        robot = read_source(again, report)
        repair(robot, folder, options.model_copy(update={"base": self.base}), report)
        assert not report.has_changes, report.entries
        assert ET.tostring(robot, encoding="unicode") == text

    def told(self, kind: str) -> list[str]:
        return [
            f"{entry.element}: {entry.text}" for entry in self.report.entries if entry.kind == kind
        ]


def loaded(robot: ET.Element, folder: Path) -> MultibodyPlant:
    plant, scene_graph = MultibodyPlant(0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_urdf(plant, with_absolute_meshes(robot, folder), name="robot", where="arm.urdf")
    plant.Finalize()
    return plant
