"""Make the humanoid's URDF and meshes: ``python models/making/humanoid.py``.

Joints, masses, centres of mass, inertias, damping and the outer sizes of the links are those of MathWorks' sm_humanoid,
which SimRob's humanoid stations use (H10S1 and others); the forms are ours. Left and right links are equal: what is
left stands turned by 180 degrees. The robot faces -y, its left is +x. In the thesis (C. Sánchez-Girón Coca, Universidad
de Valladolid, 2022, p. 61-64) it is the humanoid of MATLAB.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from rounded import Parts, block, drum, hull, mirrored, solid, wedge, write_parts
from urdf_writing import ZERO, Joint, Link, Shape, box, sphere, write_urdf

COMMENT = """
  The humanoid of MATLAB (sm_humanoid): 22 bodies, 18 joints, 2.292 kg. It faces -y; its left is +x.
  Joints, masses, inertias and damping are the published figures; yaw angles are exact, where the original has 3.1415.
  Estimates, since the original has none of them:
  - effort 3 N m: what servos of this size give, and enough for the thesis's step.
  - velocity 12 rad/s: a fast servo of this size.
  - ranges: those of a human, but for wrists and ankles, which keep the 90 degrees of the original's stops.
  The collision shapes are for falls; those of the feet are replaced by the feet that robot.yaml describes.
"""
EFFORT, VELOCITY, DAMPING = 3.0, 12.0, 0.001  # N·m, rad/s, N·m·s/rad
PI = np.pi

COLOURS = {
    "signal_orange": (0.87, 0.32, 0.16, 1),
    "salmon": (0.88, 0.57, 0.48, 1),
    "shell_white": (0.93, 0.93, 0.92, 1),
    "graphite": (0.2, 0.21, 0.23, 1),
    "grey": (0.3, 0.3, 0.31, 1),
    "eye_blue": (0.35, 0.78, 0.98, 1),
}

# name: parent, child, origin, yaw, axis, range [deg] in the joint's own sense.
JOINTS = {
    "right_shoulder_frontal": (
        "trunk",
        "right_shoulder",
        (-0.06413, 0, -0.0399),
        PI,
        "x",
        (-90, 180),
    ),
    "right_shoulder_sagittal": (
        "right_shoulder",
        "right_upper_arm",
        (0.01905, 0, 0),
        -PI / 2,
        "x",
        (-15, 180),
    ),
    "right_elbow": ("right_upper_arm", "right_lower_arm", (0, 0, -0.0889), 0, "x", (-130, 130)),
    "right_wrist": ("right_lower_arm", "right_hand", (0, 0, -0.0762), 0, "x", (-90, 90)),
    "right_hip_sagittal": ("trunk", "right_hip", (-0.01905, 0, -0.1849), 0, "y", (-45, 60)),
    "right_hip_frontal": ("right_hip", "right_upper_leg", (0, 0, -0.02286), 0, "x", (-120, 60)),
    "right_knee": ("right_upper_leg", "right_lower_leg", (-0.02537, 0, -0.1041), 0, "x", (-5, 150)),
    "right_ankle": ("right_lower_leg", "right_foot", (0, 0, -0.10414), 0, "x", (-90, 90)),
    "left_shoulder_frontal": ("trunk", "left_shoulder", (0.06413, 0, -0.0399), 0, "x", (-180, 90)),
    "left_shoulder_sagittal": (
        "left_shoulder",
        "left_upper_arm",
        (0.01905, 0, 0),
        -PI / 2,
        "x",
        (-15, 180),
    ),
    "left_elbow": ("left_upper_arm", "left_lower_arm", (0, 0, -0.0889), 0, "x", (-130, 130)),
    "left_wrist": ("left_lower_arm", "left_hand", (0, 0, -0.0762), 0, "x", (-90, 90)),
    "left_hip_sagittal": ("trunk", "left_hip", (0.01905, 0, -0.1849), PI, "y", (-45, 60)),
    "left_hip_frontal": ("left_hip", "left_upper_leg", (0, 0, -0.02286), 0, "x", (-60, 120)),
    "left_knee": ("left_upper_leg", "left_lower_leg", (-0.02537, 0, -0.1041), 0, "x", (-150, 5)),
    "left_ankle": ("left_lower_leg", "left_foot", (0, 0, -0.10414), PI, "x", (-90, 90)),
    "trunk_shoulder": ("trunk", "shoulder_line", (0, 0, -0.0399), 0, "x", (-45, 45)),
    "shoulder_neck": ("shoulder_line", "neck", (0, 0, 0.01016), 0, "z", (-90, 90)),
}
FIXED = {
    "neck_head": ("neck", "head", (0, 0, 0.06414), ZERO),
    "head_cover_fixed": ("head", "cover", ZERO, ZERO),
    "trunk_waistline_fixed": ("trunk", "waistline", (0, 0, -0.1487), ZERO),
    # Tool frames: the hands' are the original's TCP1 and TCP2; the soles' lie under the ankles, at the mesh's bottom.
    "right_hand_tool": ("right_hand", "right_hand_tcp", (0, 0, -0.020), (2 * PI / 3, 0, 0)),
    "left_hand_tool": ("left_hand", "left_hand_tcp", (0, 0, -0.020), (2 * PI / 3, 0, 0)),
    "right_sole_fixed": ("right_foot", "right_sole", (0, 0, -0.02896), ZERO),
    "left_sole_fixed": ("left_foot", "left_sole", (0, 0, -0.02896), ZERO),
}

# shape: mass, centre of mass, moments, products.
INERTIAS = {
    "trunk": (0.369, (0, 0, -0.109), (0.001334, 0.001935, 0.0006712), ZERO),
    "waistline": (0.311, ZERO, (0.0001008, 0.0002751, 0.0003104), ZERO),
    "shoulder_line": (0.049, (0, 0, 0.003), (1.753e-05, 4.884e-05, 4.634e-05), ZERO),
    "neck": (0.021, (0, 0, 0.019), (6.005e-06, 8.752e-06, 3.339e-06), ZERO),
    "head": (0.01, (0, 0.002, 0), (6.874e-06, 8.226e-06, 6.992e-06), ZERO),
    "cover": (0.004, (0, -0.024, 0), (1.03e-06, 2.06e-06, 1.03e-06), ZERO),
    "shoulder": (0.026, (0.008, 0, 0), (2.025e-06, 4.592e-06, 6.03e-06), ZERO),
    "upper_arm": (0.08, (0, 0, -0.039), (0.0001291, 0.0001346, 1.316e-05), ZERO),
    "lower_arm": (0.058, (0, 0, -0.041), (6.543e-05, 6.913e-05, 7.689e-06), ZERO),
    "hand": (0.052, (0, 0, -0.02), (1.981e-05, 2.229e-05, 9.561e-06), (0, 0, -2.684e-06)),
    "hip": (0.085, (-0.004, 0, -0.012), (3.38e-05, 2.674e-05, 1.953e-05), (0, -4.474e-06, 0)),
    "upper_leg": (
        0.176,
        (-0.025, 0, -0.063),
        (0.0004075, 0.0004285, 4.997e-05),
        (0, -7.163e-06, 0),
    ),
    "lower_leg": (0.161, (0, 0, -0.052), (0.0003775, 0.0003872, 3.398e-05), ZERO),
    "foot": (0.126, (0, -0.013, -0.011), (0.0001256, 3.787e-05, 0.0001145), (0, 0, -2.238e-05)),
}
PAIRED = ("shoulder", "upper_arm", "lower_arm", "hand", "hip", "upper_leg", "lower_leg", "foot")

COLLISIONS: dict[str, list[Shape]] = {
    "trunk": [box((0.128, 0.051, 0.187), (0, 0, -0.108))],
    "head": [sphere(0.037)],
    "upper_arm": [box((0.036, 0.031, 0.105), (0, 0, -0.043))],
    "lower_arm": [box((0.033, 0.024, 0.09), (0, 0, -0.038))],
    "hand": [sphere(0.018, (0, 0, -0.028))],
    "upper_leg": [box((0.048, 0.038, 0.13), (-0.025, 0, -0.052))],
    "lower_leg": [box((0.05, 0.038, 0.13), (0, 0, -0.052))],
    "foot": [box((0.0559, 0.113, 0.02), (0, -0.02372, -0.01896))],
}


def trunk() -> Parts:
    """Chest that narrows to the waist, with a dark inlay in front and a battery on the back."""
    corners = [(0.0641, y, z) for y in (-0.0254, 0.0254) for z in (-0.0145, -0.082)]
    shell = wedge([*corners, (0.040, -0.0225, -0.2014), (0.040, 0.0225, -0.2014)], 0.011)
    inlay = wedge(
        [
            (0.036, -0.0268, -0.050),
            (0.036, -0.0268, -0.094),
            (0.020, -0.0268, -0.122),
            (0.03, 0, -0.06),
        ],
        0.003,
    )
    pack = block((-0.040, 0.0, -0.125), (0.040, 0.0285, -0.040), 0.006)
    lamp = drum(0.0065, (-0.0277, -0.0200), "y", (0, 0, -0.070), 0.001)
    return {"signal_orange": [shell], "graphite": [inlay, pack], "eye_blue": [lamp]}


def waistline() -> Parts:
    """Pelvis that carries both hips."""
    low = [(0.0473, y, 0.0203) for y in (-0.0254, 0.0254)] + [
        (0.040, y, -0.0203) for y in (-0.0254, 0.0254)
    ]
    return {"graphite": [wedge(low, 0.009)]}


def shoulder_line() -> Parts:
    """Roll of the shoulders, with the seat of the neck."""
    roll = hull([(-0.0331, 0, 0), (0.0331, 0, 0)], 0.019)
    return {"salmon": [roll, drum(0.017, (0.0, 0.0195), "z", fillet=0.004)]}


def neck() -> Parts:
    """Fork that holds the head between its tines."""
    seat = block((-0.0349, -0.0101, 0.012), (0.0349, 0.0101, 0.0215), 0.004)
    side = block((0.0311, -0.0101, 0.013), (0.0349, 0.0101, 0.0745), 0.0018)
    return {"graphite": [drum(0.012, (-0.0025, 0.016)), seat, side, mirrored(side)]}


def head() -> Parts:
    """Ball that is flat in front and where the fork holds it, with two eyes."""
    ball = np.asarray(trimesh.creation.icosphere(subdivisions=4, radius=0.0392).vertices)
    skull = solid(np.clip(ball, (-0.0302, -0.0240, -1.0), (0.0302, 1.0, 1.0)))
    ears = [drum(0.013, (-0.0335, 0.0335), "x", fillet=0.001)]
    eyes = [drum(0.0052, (-0.0254, -0.0200), "y", (x, 0, 0.004), 0.0008) for x in (-0.0105, 0.0105)]
    return {"shell_white": [skull], "grey": ears, "eye_blue": eyes}


def cover() -> Parts:
    """Dark glass before the face."""
    low = [
        (0.0215, -0.0246, 0.0165),
        (0.0215, -0.0246, -0.0105),
        (0.0215, -0.0215, 0.0165),
        (0.0215, -0.0215, -0.0105),
    ]
    return {"graphite": [wedge(low, 0.0012)]}


def shoulder() -> Parts:
    """Servo between trunk and upper arm."""
    return {
        "graphite": [
            block((-0.0178, -0.0175, -0.0089), (0.0254, 0.0175, 0.0089), 0.004),
            # its ends stand out of the arm, which is 38 mm thick
            drum(0.0089, (-0.0203, 0.0203), "y", (0.0172, 0, 0)),
        ]
    }


def upper_arm() -> Parts:
    """Sleeve from shoulder to elbow."""
    sleeve = hull(
        [(x, y, z) for x in (-0.0085, 0.0085) for y in (-0.006, 0.006) for z in (0.006, -0.072)],
        0.0105,
    )
    joint = drum(0.0127, (-0.0165, 0.0165), "x", (0, 0, -0.0889))
    return {"shell_white": [sleeve], "graphite": [joint]}


def lower_arm() -> Parts:
    """Fore-arm that narrows to the wrist."""
    top = [(x, y, -0.020) for x in (-0.0088, 0.0088) for y in (-0.0037, 0.0037)]
    sleeve = hull([*top, (-0.0058, 0, -0.060), (0.0058, 0, -0.060)], 0.009)
    # covers the ends of the elbow
    cheek = block((0.0132, -0.0130, -0.030), (0.0186, 0.0130, 0.0115), 0.002)
    joint = drum(0.0095, (-0.0125, 0.0125), "x", (0, 0, -0.0762))
    return {"shell_white": [sleeve, cheek, mirrored(cheek)], "graphite": [joint]}


def hand() -> Parts:
    """Cup of two fingers and a thumb."""
    palm = wedge([(0.0165, y, z) for y in (-0.009, 0.0105) for z in (-0.006, -0.026)], 0.0065)
    fingers = [hull([(x, -0.004, -0.024), (x, -0.0105, -0.041)], 0.0058) for x in (-0.0105, 0.0105)]
    thumb = hull([(0, 0.006, -0.022), (0, 0.0085, -0.038)], 0.0058)
    cuff = drum(0.0105, (-0.0135, 0.0135), "x", (0, 0, 0.0))
    return {"grey": [palm, *fingers, thumb], "graphite": [cuff]}


def hip() -> Parts:
    """Two crossed servos."""
    pan = block((-0.0165, -0.0165, -0.0419), (0.0165, 0.0165, 0.0), 0.004)
    axle = drum(0.0155, (-0.019, 0.019), "y", (0, 0, 0))
    return {"graphite": [pan, axle]}


def upper_leg() -> Parts:
    """Thigh from the hip's side to the knee."""
    top = [(-0.026 + x, y, z) for x in (-0.0135, 0.0135) for y in (-0.008, 0.008) for z in (0.006,)]
    low = [(-0.026 + x, y, -0.086) for x in (-0.0115, 0.0115) for y in (-0.005, 0.005)]
    joint = drum(0.0165, (-0.0235, 0.0235), "x", (-0.02537, 0, -0.1041))
    disc = drum(0.015, (-0.0520, 0.0013), "x", (0, 0, 0))
    return {"shell_white": [hull([*top, *low], 0.0108)], "graphite": [joint, disc]}


def lower_leg() -> Parts:
    """Shank with a calf, and cheeks about the knee."""
    shank = [
        (x, y, z)
        for x in (-0.0125, 0.0125)
        for y, z in ((-0.0055, -0.028), (0.0075, -0.034), (-0.0045, -0.084), (0.0045, -0.084))
    ]
    cheek = block((0.0222, -0.0135, -0.045), (0.0267, 0.0135, 0.0155), 0.002)
    joint = drum(0.0135, (-0.0185, 0.0185), "x", (0, 0, -0.10414))
    return {"shell_white": [hull(shank, 0.0108), cheek, mirrored(cheek)], "graphite": [joint]}


def foot() -> Parts:
    """Shoe with a dark sole; the toes lie at -y."""
    low = [(0.0279, -0.066, -0.0215), (0.0279, 0.0328, -0.0215), (0.0215, -0.0802, -0.0215)]
    high = [(0.0235, -0.052, -0.006), (0.0235, 0.029, -0.006)]
    shoe = hull(
        [
            (s * (x - 0.005), y - 0.005 * np.sign(y), z)
            for x, y, z in [*low, *high]
            for s in (-1, 1)
        ],
        0.005,
    )
    sole = block((-0.0279, -0.0802, -0.02896), (0.0279, 0.0328, -0.0205), 0.003)
    cheek = block((0.0195, -0.0125, -0.010), (0.0240, 0.0125, 0.0165), 0.002)
    return {"shell_white": [shoe, cheek, mirrored(cheek)], "graphite": [sole]}


FORMS = {
    f.__name__: f
    for f in (trunk, waistline, shoulder_line, neck, head, cover, shoulder, upper_arm, lower_arm)
}
FORMS |= {f.__name__: f for f in (hand, hip, upper_leg, lower_leg, foot)}


def make(folder: Path) -> None:
    """Write the URDF and its meshes into a folder."""
    visuals = {name: write_parts(folder, name, form()) for name, form in FORMS.items()}
    links = []
    for shape, (mass, com, moments, products) in INERTIAS.items():
        for name in (
            [f"{side}_{shape}" for side in ("right", "left")] if shape in PAIRED else [shape]
        ):
            figures = {"mass": mass, "com": com, "moments": moments, "products": products}
            links.append(
                Link(
                    name=name,
                    **figures,
                    visuals=visuals[shape],
                    collisions=COLLISIONS.get(shape, []),
                )
            )
    links += [
        Link(name=f"{side}_{frame}") for frame in ("hand_tcp", "sole") for side in ("right", "left")
    ]
    joints = []
    for name, (parent, child, xyz, yaw, axis, (low, high)) in JOINTS.items():
        joints.append(
            Joint(
                name=name,
                parent=parent,
                child=child,
                xyz=xyz,
                rpy=(0, 0, yaw),
                axis=[float(letter == axis) for letter in "xyz"],
                range=(np.deg2rad(low), np.deg2rad(high)),
                effort=EFFORT,
                velocity=VELOCITY,
                damping=0.05 if name == "trunk_shoulder" else DAMPING,
            )
        )
    joints += [
        Joint(name=n, parent=p, child=c, xyz=xyz, rpy=rpy) for n, (p, c, xyz, rpy) in FIXED.items()
    ]
    write_urdf(
        folder / "humanoid.urdf", comment=COMMENT, colours=COLOURS, links=links, joints=joints
    )


if __name__ == "__main__":
    make(Path(__file__).parents[1] / "humanoid")
