"""The JSON Schemas of the files under ``models/``, for editors that complete and check YAML."""

from typing import Any

from simrob_drake.paths import models_root
from simrob_drake.programs.gaits.parameters import Gaits
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.pieces import PieceModel
from simrob_drake.yaml_files import file_schema, write_schema


def model_schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas of ``robot.yaml``, ``piece.yaml`` and ``gaits.yaml`` by the names of their files."""
    robot = file_schema(RobotModel, from_place=("name", "folder", "root", "axes"))
    robot["oneOf"] = [{"required": ["urdf", "root", "axes"]}, {"required": ["dh"]}]
    piece = file_schema(PieceModel, from_place=("folder",))
    for schema in (robot, piece):
        del schema["properties"]["folder"]
    return {"robot.schema.json": robot, "piece.schema.json": piece, "gaits.schema.json": file_schema(Gaits)}


if __name__ == "__main__":
    for name, schema in model_schemas().items():
        print(write_schema(models_root() / name, schema))
