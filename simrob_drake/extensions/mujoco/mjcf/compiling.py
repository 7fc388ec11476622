"""MuJoCo's compiler, in a process of its own that opens nothing: given a text and what it asks for, it says figures.

Only meshes that a mass or a fitted shape comes from are asked for. In place of the others MuJoCo gets a small body, so
that their poses stay those of their files. ``python -m simrob_drake.extensions.mujoco.mjcf.compiling`` talks as
:mod:`simrob_drake.importer.reading.child` does.
"""

from base64 import b64decode
from pathlib import PurePosixPath
from typing import Any

import mujoco

from simrob_drake.importer.reading.child import ask, serve

SECONDS = 100  # of processor time that a model may take: hulls of many large meshes take long
_OCTAHEDRON = [
    1.0,
    0,
    0,
    -1,
    0,
    0,
    0,
    2,
    0,
    0,
    -2,
    0,
    0,
    0,
    3,
    0,
    0,
    -3,
]  # its own frame is that of its corners
_FIELDS = {
    "body": "parentid jntadr jntnum pos quat ipos iquat mass inertia mocapid gravcomp",
    "jnt": "type bodyid dofadr qposadr pos axis limited range stiffness actfrclimited actfrcrange",
    "dof": "armature damping frictionloss",
    "geom": "type bodyid dataid matid group contype conaffinity pos quat size rgba friction",
    "mat": "rgba",
    "mesh": "pos quat scale",
    "site": "bodyid pos quat",
    "tendon": "adr num",
    "wrap": "type objid prm",
    "actuator": "trntype trnid gear forcelimited forcerange ctrllimited ctrlrange dyntype gaintype gainprm biastype"
    " biasprm",
    "eq": "type objtype obj1id obj2id active0 data",
    "key": "qpos",
}
_NAMED = {"jnt": "joint", "mat": "material", "eq": "equality"} | {
    kind: kind for kind in ("body", "mesh", "geom", "site", "tendon", "actuator", "key")
}  # what has names, by what its fields begin with, as MuJoCo calls its kind


def compiled(job: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the model in the text ``xml``, under MuJoCo's names for them, as lists.

    ``meshes`` of the job are the names of mesh files by those of meshes. Among the figures ``mesh_file``,
    ``mesh_refpos`` and ``mesh_refquat`` are as they were written, and ``mesh_missing`` names the meshes that a mass
    should come from but that cannot be had. Raises ValueError: MuJoCo refuses it.
    """
    spec = mujoco.MjSpec.from_string(job["xml"])
    weighed, missing = _weighed(spec), []
    files = job["meshes"]
    places = {
        mesh.name: (files.get(mesh.name, ""), mesh.refpos.tolist(), mesh.refquat.tolist())
        for mesh in spec.meshes
    }
    assets = {}
    for number, mesh in enumerate(mesh for mesh in spec.meshes if mesh.name in files):
        content = ask("mesh", files[mesh.name]) if mesh.name in weighed else None
        if content is not None:
            mesh.file = f"{number}{PurePosixPath(files[mesh.name]).suffix.lower()}"
            assets[mesh.file] = b64decode(content)
            continue
        mesh.uservert = _OCTAHEDRON
        if mesh.name in weighed:
            missing.append(mesh.name)
    spec.assets = assets
    spec.compiler.usethread = False  # a confined process starts none
    model = spec.compile()
    read = {
        f"{kind}_{field}": getattr(model, f"{kind}_{field}").tolist()
        for kind, fields in _FIELDS.items()
        for field in fields.split()
    }
    for kind, called in _NAMED.items():
        number = getattr(mujoco.mjtObj, f"mjOBJ_{called.upper()}")
        count = len(read[f"{kind}_{_FIELDS[kind].split()[0]}"])
        read[f"{kind}_name"] = [
            mujoco.mj_id2name(model, number, index) or "" for index in range(count)
        ]
    for place, key in enumerate(("file", "refpos", "refquat")):
        read[f"mesh_{key}"] = [places[name][place] for name in read["mesh_name"]]
    return {**read, "qpos0": model.qpos0.tolist(), "mesh_missing": missing}


def _weighed(spec: Any) -> set[str]:
    """Return the names of the meshes from which MuJoCo takes masses or the sizes of other shapes."""
    every = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    fitted = {geom.meshname for geom in spec.geoms if geom.type != mujoco.mjtGeom.mjGEOM_MESH}
    bodies = [
        body
        for body in spec.bodies
        if body.name != "world" and (every or not body.explicitinertial)
    ]
    return fitted | {geom.meshname for body in bodies for geom in body.geoms}


if __name__ == "__main__":
    serve(compiled, SECONDS)
