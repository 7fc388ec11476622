"""Read a robot that a user names: by the name of a robot of the package, or by the path of a file."""

from pathlib import Path

from simrob_drake.base.errors import InvalidModel, InvalidParameter, quote_value
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import is_yaml_name
from simrob_drake.importer.robot_files import is_robot_file
from simrob_drake.robots.catalog import RobotModel, load_robot, load_robot_file
from simrob_drake.robots.imports import ImportOptions
from simrob_drake.robots.urdf import with_absolute_meshes


def read_robot(robot: str | Path, options: ImportOptions | None = None) -> RobotModel:
    """Read the robot of a name or a path.

    Stations, the commands and Python functions read robots by this function, so that all of them accept the same files.

    Args:
        robot: a name of ``simrob list``, the path of a YAML file that describes a robot, the path of a URDF or
            another file that is imported, or the name of a robot of ``robot_descriptions``.
        options: options of the import. Robots of YAML files and of the package have none.

    Raises:
        SimrobError: there is no such robot, or its files have a defect.
    """
    if not isinstance(robot, (str, Path)):
        raise InvalidParameter(
            "robot",
            quote_value(robot),
            message("importer.name_or_path", "a name of `simrob list`, or a path"),
        )
    # The form of the name decides, not whether such a file exists, so that an error is about the right sort of file.
    if is_yaml_name(robot):
        return read_described_robot(Path(robot))
    if is_robot_file(str(robot)) or Path(robot).suffix:
        # Imported here because few stations need the importer, which is slow to load.
        from simrob_drake.importer.importing import robot_from_file

        return robot_from_file(robot, options)
    return load_robot(str(robot))


def read_described_robot(file: Path) -> RobotModel:
    """Read the robot that a YAML file describes.

    If the description's URDF is not one that Drake can simulate, for example because its meshes are STL files, the URDF
    is imported, and the robot has the URDF of the import.

    Raises:
        SimrobError: the file or the URDF has a defect that no import can repair.
    """
    robot = load_robot_file(file)
    try:
        with_absolute_meshes(robot.element, robot.folder)
    except InvalidModel:
        if robot.urdf is None:
            raise
        from simrob_drake.importer.importing import robot_from_file

        imported = robot_from_file(robot.urdf_path)
        # Axes, gains and postures stay those of the YAML file.
        return robot.model_copy(update={"folder": imported.folder, "urdf": imported.urdf})
    return robot
