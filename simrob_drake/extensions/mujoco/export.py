"""Write a station as an MJCF file that MuJoCo loads by itself, with its meshes and controls beside."""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from simrob_drake.base.arguments import as_path
from simrob_drake.base.folders import (
    check_ending,
    check_new_file,
    filled_at_once,
    replaced_at_once,
    writing,
)
from simrob_drake.extensions.mujoco.model import STEP
from simrob_drake.extensions.mujoco.runner import MujocoRunner, RunRequest
from simrob_drake.stations.config import StationConfig

CONTROLS = "controls.csv"  # the file beside an MJCF file that holds a row of controls for each step


def save_mjcf(
    config: StationConfig, file: Path | str, *, step: float = STEP, force: bool = False
) -> list[Path]:
    """Write a station as MJCF for steps of a length [s], and return what was written; ``force`` replaces what is there.

    Beside ``station.xml`` a folder ``station_mjcf`` holds the meshes, and the controls over the station's duration: a
    row for each step of the references of the axes and the forces that act. The keyframe ``start`` is where it begins.
    Figures have six digits, as MuJoCo writes them. Raises InvalidParameter: a station that MJCF cannot say, or an
    ending other than ``.xml``; OutputError: the file is there, or the disk does not take it.
    """
    file = as_path(file, "file")
    check_ending(file, [".xml"], "--mjcf")
    check_new_file(file, force=force)
    runner = MujocoRunner(config, step=step, seen=True)
    spec, folder = runner.built.spec, file.with_name(f"{file.stem}_mjcf")
    prepared = runner.prepared(config, RunRequest())
    model = runner.built.model
    qpos, qvel = prepared.start[1 : 1 + model.nq], prepared.start[1 + model.nq :][: model.nv]
    spec.add_key(name="start", qpos=qpos, qvel=qvel, ctrl=prepared.controls[0])
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
    with filled_at_once(folder, marker=CONTROLS, force=force) as work:
        names = ["time", *(model.actuator(index).name for index in range(model.nu))]
        rows = np.column_stack(
            [runner.built.step * np.arange(len(prepared.controls)), prepared.controls]
        )
        np.savetxt(
            work / CONTROLS, rows, delimiter=",", header=",".join(names), comments="", fmt="%.10g"
        )
        written = ET.fromstring(spec.to_xml())
        for mesh in written.iter("mesh"):
            kept = f"{mesh.get('name')}{Path(mesh.get('file', '')).suffix}"
            shutil.copyfile(mesh.get("file", ""), work / kept)
            mesh.set("file", f"{folder.name}/{kept}")
        with replaced_at_once(file) as whole:
            lines = ET.tostring(written, encoding="unicode").splitlines()
            whole.write_text(
                "\n".join(line for line in lines if line.strip()) + "\n", encoding="utf-8"
            )
    return [file, folder]
