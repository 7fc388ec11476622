"""What a user may choose about an import."""

from pathlib import Path
from typing import Literal

from simrob_drake.quantities import Positive
from simrob_drake.yaml_files import Strict


class ImportOptions(Strict):
    """Choices of an import; the defaults suit most robots."""

    mesh_path: tuple[Path, ...] = ()
    """Further folders in which meshes and packages are looked for; those in a station's file start at its folder."""
    collision: Literal["hull", "box", "none"] = "hull"
    """Collision meshes become their convex hull, the tightest box around them, or nothing."""
    estimate_inertia: bool = False
    """Estimate missing and impossible inertias from the geometry, at `density`."""
    density: Positive = 1000.0
    """Of links whose inertia is estimated [kg/m³]."""
    base: Literal["auto", "fixed", "floating"] = "auto"
    """Whether the root link is fixed to the world; `auto` decides by the file and the shape of the robot."""
    friction_as_damping: bool = False
    """Add the joints' Coulomb friction, which is left out otherwise, to their viscous damping."""
    xacro_arg: tuple[str, ...] = ()
    """Value of an argument of a xacro file, as in `ur_type:=ur5e`."""
    drop_loops: bool = False
    """Leave joints out that close a loop, which no tree of motored joints has, instead of refusing the robot."""
