"""The JSON Schemas of the files under ``models/`` and of programs, for editors that complete and check YAML.

Run as a script, this module writes them to ``models/``.
"""

from typing import Any

from simrob_drake.base.files import models_root
from simrob_drake.base.sections import file_schema, write_schema
from simrob_drake.programs.gaits.registry import gaits_model
from simrob_drake.programs.program import Program
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.pieces import PieceModel


def model_schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas of robots, pieces, gaits and programs, by the names of the files that contain the schemas."""
    # `from_place` names required fields that a file need not have: the loader can set them.
    robot = file_schema(RobotModel, from_place=("name", "folder", "root", "axes"))
    # A robot is described by a URDF with its axes, or by a table of Denavit and Hartenberg, not by both.
    robot["oneOf"] = [{"required": ["urdf", "root", "axes"]}, {"required": ["dh"]}]
    piece = file_schema(PieceModel, from_place=("folder",))
    # The loader sets the folder. A file cannot.
    for schema in (robot, piece):
        del schema["properties"]["folder"]
    others = {
        "gaits.schema.json": file_schema(gaits_model()),
        "program.schema.json": file_schema(Program),
    }
    return {"robot.schema.json": robot, "piece.schema.json": piece, **others}


if __name__ == "__main__":
    for name, schema in model_schemas().items():
        print(write_schema(models_root() / name, schema))
