"""The JSON Schema of station files, for editors that complete and check YAML."""

import json
from pathlib import Path
from typing import Any

from simrob_drake.base.files import diagrams_root
from simrob_drake.parts import couplings, forces, monitors, sensors
from simrob_drake.stations.config import RobotConfig, StationConfig

SCHEMA_FILE = "station.schema.json"


def station_schema() -> dict[str, Any]:
    """Return the schema of a station file: that of a configuration, with ``robot:`` for a single robot."""
    schema = StationConfig.model_json_schema()
    schema["properties"]["robot"] = {"$ref": "#/$defs/RobotConfig", "description": RobotConfig.__doc__}
    schema["properties"]["program"]["anyOf"] = [{"type": "string"}, {"$ref": "../models/program.schema.json"}]
    schema["required"] = [key for key in schema["required"] if key not in ("name", "robots")]
    schema["oneOf"] = [{"required": [key]} for key in ("robot", "robots")]
    schema["oneOf"].append({"required": ["pieces"], "properties": {"robot": False, "robots": {"maxProperties": 0}}})
    for family in (monitors, sensors, couplings, forces):
        for entry in family.KINDS.models.values():
            schema["$defs"][entry.__name__]["required"].remove("kind")  # a part's name can be its kind
    return schema


def write_schema(folder: Path) -> Path:
    """Write the schema into a folder and return the file."""
    file = folder / SCHEMA_FILE
    file.write_text(json.dumps(station_schema(), indent=1) + "\n", encoding="utf-8")
    return file


if __name__ == "__main__":
    print(write_schema(diagrams_root()))
