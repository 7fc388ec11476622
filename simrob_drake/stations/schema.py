"""The JSON Schema of station files, for editors that complete and check YAML."""

import json
from pathlib import Path
from typing import Any

from simrob_drake.base.files import diagrams_root
from simrob_drake.parts import couplings, forces, monitors, sensors
from simrob_drake.stations.config import RobotConfig, StationConfig

SCHEMA_FILE = "station.schema.json"


def station_schema() -> dict[str, Any]:
    """Make the schema of a station's file: that of a configuration, except for what a file may write in a shorter form.

    A file may have ``robot:`` for a single robot, a program as the path of a file, no name, and monitors, sensors,
    couplings and forces without a kind, whose names are kinds. It may leave out the robots if it has pieces.
    """
    schema = StationConfig.model_json_schema()
    properties = schema["properties"]
    properties["robot"] = {"$ref": "#/$defs/RobotConfig", "description": RobotConfig.__doc__}
    program_schema = {"$ref": "../models/program.schema.json"}
    properties["program"]["anyOf"] = [{"type": "string"}, program_schema]
    # A station without a name gets that of its file, and one with `robot` needs no `robots`.
    schema["required"] = [key for key in schema["required"] if key not in ("name", "robots")]
    schema["oneOf"] = [{"required": [key]} for key in ("robot", "robots")]
    # A station without robots moves pieces only.
    no_robots = {"robot": False, "robots": {"maxProperties": 0}}
    schema["oneOf"].append({"required": ["pieces"], "properties": no_robots})
    for family in (monitors, sensors, couplings, forces):
        for entry in family.KINDS.models.values():
            # An entry such as `monitors.fall` has the kind of its name.
            schema["$defs"][entry.__name__]["required"].remove("kind")
    return schema


def write_schema(folder: Path) -> Path:
    """Write the schema into a folder and return the file."""
    file = folder / SCHEMA_FILE
    file.write_text(json.dumps(station_schema(), indent=1) + "\n", encoding="utf-8")
    return file


if __name__ == "__main__":
    print(write_schema(diagrams_root()))
