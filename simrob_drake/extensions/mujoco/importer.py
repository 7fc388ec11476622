"""The importer of MJCF files, which hold robots as MuJoCo describes them."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import ClassVar

from simrob_drake.base.messages import message
from simrob_drake.importer.importer import RobotImporter
from simrob_drake.robots.imports import ImportOptions, ImportReport


class MjcfImporter(RobotImporter):
    """Reads a robot from an MJCF file (extra `mujoco`)."""

    title: ClassVar[str] = message("mujoco.an_mjcf_file", "an MJCF file")

    def robot_element(
        self, root: ET.Element, path: Path, options: ImportOptions, report: ImportReport
    ) -> ET.Element:
        """Translate an MJCF file into the element ``robot`` of a URDF.

        Args:
            root: outermost element of the file.
            path: absolute path of the file.
            options: the user's choices for the import.
            report: record of all that is changed or lost.

        Raises:
            InvalidModel: MuJoCo is not installed or refuses the file, or the file holds no robot.
        """
        from simrob_drake.extensions.mujoco.mjcf.reading import read_mjcf

        return read_mjcf(root, path, options, report)
