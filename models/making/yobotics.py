"""Make the quadruped's URDF and meshes: ``python models/making/yobotics.py``.

Joints, ranges, efforts, masses and inertias are those of the published yobotics_description, which the thesis of
C. Sánchez-Girón Coca (Universidad de Valladolid, 2022, p. 89-91) uses; the forms are ours. It faces +x, its left is +y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rounded import Parts, block, drum, hull, mirrored_parts, write_parts
from urdf_writing import Joint, Link, Shape, box, cylinder, sphere, write_urdf

COMMENT = """
  Yobotics quadruped: 12 joints, 9.443 kg, legs of 0.2115 and 0.2304 m. It faces +x; all frames are parallel at zero.
  Joint places, ranges, 20 N m, 10.6 rad/s, masses and inertias are the published figures. Ours are:
  - trunk: one link of the massless root and what is welded to it.
  - hips and thighs: their centres of mass lie outward, as their shapes do; the file has them inward by as much.
  - calf: its centre of mass lies 61 mm under the knee. Both are as in the MIT Mini Cheetah, whose thigh and calf have
    the same masses; the file has the calf's in the knee, with an inertia that fits a rod's about its own middle.
  - damping 0.01 N m s/rad: an estimate of the gears' losses; the file has none.
"""
EFFORT, VELOCITY, DAMPING = 20.0, 10.6, 0.01  # N·m, rad/s, N·m·s/rad
THIGH, CALF, FOOT_RADIUS = 0.2115, 0.23039, 0.025  # m

COLOURS = {
    "bone_white": (0.9, 0.89, 0.86, 1),
    "gold": (0.86, 0.64, 0.22, 1),
    "ice_blue": (0.76, 0.85, 0.92, 1),
    "carbon": (0.16, 0.165, 0.18, 1),
    "lens": (0.3, 0.75, 0.95, 1),
}
LEGS = {"RL": (-1, 1), "FL": (1, 1), "RR": (-1, -1), "FR": (1, -1)}  # signs of x and y

# mass, centre of mass on the left side, moments, products.
INERTIAS = {
    "hip": (0.57, (0, 0.036, 0), (0.0007148275, 0.0007955775, 0.00068875)),
    "thigh": (0.634, (0, 0.016, -0.11), (0.002618209, 0.002654822, 0.0001587642)),
    "calf": (0.064, (0, 0, -0.061), (0.0002146987, 0.0002146987, 2.730667e-06)),
    "foot": (0.15, (0, 0, 0), (4.2135e-05, 4.2135e-05, 4.2135e-05)),
}
CARRIED = {  # on the trunk: place, mass, centre of mass, moments
    "trunk_body": ((0, 0, 0), 0, 3.3, (0.011253, 0.036203, 0.042673)),
    "hokuyo_frame": ((0, 0, 0.093), 0, 0.27, (0.0002632, 0.0002632, 0.000162)),
    "camera_link": ((0.1, 0, -0.06), 0.2617996, 0.2, (0.00058083, 3.0833e-05, 0.00059083)),
    "imu_link": ((0, 0, 0), 0, 0.001, (1e-09, 1e-09, 1e-09)),
}


def trunk_body() -> Parts:
    """Slim body between two hip girdles."""
    shell = hull(
        [(x, y, z) for x in (-0.130, 0.130) for y in (-0.058, 0.058) for z in (-0.022, 0.020)],
        0.022,
    )
    back = hull([(x, y, 0.040) for x in (-0.105, 0.070) for y in (-0.036, 0.036)], 0.009)
    girdles = [
        block((x - 0.0285, -0.049, -0.042), (x + 0.0285, 0.049, 0.040), 0.014)
        for x in (-0.160, 0.160)
    ]
    rails = [hull([(-0.150, y, -0.034), (0.150, y, -0.034)], 0.0105) for y in (-0.064, 0.064)]
    stripe = hull([(x, y, 0.0415) for x in (-0.085, 0.050) for y in (-0.006, 0.006)], 0.0085)
    return {"bone_white": [shell], "carbon": [*girdles, back, *rails], "gold": [stripe]}


def hokuyo_frame() -> Parts:
    """Lidar on its foot."""
    body = [
        block((-0.029, -0.029, -0.048), (0.029, 0.029, -0.012), 0.006),
        drum(0.0255, (-0.012, 0.004), fillet=0.003),
    ]
    return {
        "carbon": [*body, drum(0.0265, (0.012, 0.032), fillet=0.006)],
        "gold": [drum(0.0235, (0.003, 0.0125))],
    }


def camera_link() -> Parts:
    """Depth camera in front, under the body."""
    bar = hull([(0.0, y, 0.0) for y in (-0.072, 0.072)], 0.0145)
    eyes = [drum(0.0085, (0.0085, 0.0158), "x", (0, y, 0), 0.001) for y in (-0.046, 0.0, 0.046)]
    return {
        "carbon": [bar, block((-0.022, -0.012, 0.0), (0.006, 0.012, 0.030), 0.004)],
        "lens": eyes,
    }


def hip() -> Parts:
    """Motor of the abduction, and that of the thigh beside it; of a left leg."""
    motor = drum(0.0445, (-0.034, 0.034), "x", fillet=0.008)
    side = drum(0.0435, (0.028, 0.0500), "y", (0, 0, 0), 0.005)
    bridge = hull([(0.0, 0.0, 0.0), (0.0, 0.030, 0.0)], 0.0335)
    return {"gold": [motor, bridge], "carbon": [side]}


def thigh() -> Parts:
    """Upper leg with the motor of the knee at its top; of a left leg."""
    motor = drum(0.0425, (-0.0265, 0.0165), "y", (0, 0, 0), 0.006)
    cap = drum(0.027, (0.0165, 0.0205), "y", (0, 0, 0), 0.002)
    top = [(x, y, -0.010) for x in (-0.022, 0.022) for y in (-0.005, 0.005)]
    shell = hull(
        [*top, *((x, y, -THIGH) for x in (-0.004, 0.004) for y in (-0.004, 0.004))], 0.0125
    )
    knee = drum(0.0195, (-0.0185, 0.0185), "y", (0, 0, -THIGH), 0.002)
    return {"ice_blue": [shell], "carbon": [motor, knee], "gold": [cap]}


def calf() -> Parts:
    """Thin lower leg."""
    shin = hull([(0.0, 0, 0.0), (0.0045, 0, -0.060), (0.0, 0, -CALF + 0.035)], 0.0105)
    guard = hull([(0.0105, 0, -0.035), (0.0105, 0, -0.105)], 0.0082)
    return {"ice_blue": [shin], "gold": [guard]}


def foot() -> Parts:
    """Rubber ball; the leg ends where it touches the floor."""
    return {
        "carbon": [
            hull([(0, 0, FOOT_RADIUS), (0, 0, FOOT_RADIUS + 1e-4)], FOOT_RADIUS),
            drum(0.0135, (0.035, 0.062), fillet=0.003),
        ]
    }


def make(folder: Path) -> None:
    """Write the URDF and its meshes into a folder."""
    carried = {"trunk_body": write_parts(folder, "trunk_body", trunk_body()), "imu_link": []}
    carried |= {
        "hokuyo_frame": write_parts(folder, "hokuyo", hokuyo_frame()),
        "camera_link": write_parts(folder, "camera", camera_link()),
    }
    bumpers: dict[str, list[Shape]] = {
        "trunk_body": [box((0.34, 0.13, 0.085), (0, 0, 0))],
        "hokuyo_frame": [box((0.058, 0.058, 0.087), (0, 0, -0.0115))],
    }
    links, joints = [], []
    for name, (xyz, pitch, mass, moments) in CARRIED.items():
        link = "trunk" if name == "trunk_body" else name
        links.append(
            Link(
                name=link,
                mass=mass,
                moments=moments,
                visuals=carried[name],
                collisions=bumpers.get(name, []),
            )
        )
        if link != "trunk":
            joints.append(
                Joint(name=f"{link}_fixed", parent="trunk", child=link, xyz=xyz, rpy=(0, pitch, 0))
            )
    forms = (hip, thigh, calf, foot)
    drawn = {
        ("left", form.__name__): write_parts(folder, f"left_{form.__name__}", form())
        for form in forms[:2]
    }
    for form in forms[:2]:
        parts = mirrored_parts(form(), "y")
        drawn["right", form.__name__] = write_parts(folder, f"right_{form.__name__}", parts)
    for form in forms[2:]:
        drawn["left", form.__name__] = drawn["right", form.__name__] = write_parts(
            folder, form.__name__, form()
        )
    for leg, (front, left) in LEGS.items():
        side = "left" if left > 0 else "right"
        for part, (mass, (x, y, z), moments) in INERTIAS.items():
            shapes = {
                "hip": [cylinder(0.0445, 0.068, rpy=(0, np.pi / 2, 0))],
                "thigh": [box((0.043, 0.034, 0.2), (0, 0, -0.105))],
                "calf": [box((0.016, 0.016, 0.18), (0, 0, -0.1))],
                "foot": [sphere(FOOT_RADIUS, (0, 0, FOOT_RADIUS))],
            }
            inertia = {"mass": mass, "com": (x, left * y, z), "moments": moments}
            name = f"{leg}_{part}"
            links.append(
                Link(name=name, **inertia, visuals=drawn[side, part], collisions=shapes[part])
            )
        joints += _leg_joints(leg, front, left)
    write_urdf(
        folder / "yobotics.urdf", comment=COMMENT, colours=COLOURS, links=links, joints=joints
    )


def _leg_joints(leg: str, front: int, left: int) -> list[Joint]:
    low, high = np.deg2rad([-50, 60])
    figures = {"effort": EFFORT, "velocity": VELOCITY, "damping": DAMPING}
    hip_range = (low, high) if left > 0 else (-high, -low)
    hip_place = (front * 0.196, left * 0.049664, 0)
    names = [f"{leg}_{part}" for part in ("hip", "thigh", "calf", "foot")]
    thigh_range = (np.deg2rad(-30), np.deg2rad(225))
    return [
        Joint(
            name=f"{leg}_hip_joint",
            parent="trunk",
            child=names[0],
            xyz=hip_place,
            axis=(1, 0, 0),
            range=hip_range,
            **figures,
        ),
        Joint(
            name=f"{leg}_thigh_joint",
            parent=names[0],
            child=names[1],
            xyz=(0, left * 0.077476, 0),
            axis=(0, 1, 0),
            range=thigh_range,
            **figures,
        ),
        Joint(
            name=f"{leg}_calf_joint",
            parent=names[1],
            child=names[2],
            xyz=(0, 0, -THIGH),
            axis=(0, 1, 0),
            range=(-np.pi, np.pi),
            **figures,
        ),
        Joint(name=f"{leg}_foot_fixed", parent=names[2], child=names[3], xyz=(0, 0, -CALF)),
    ]


if __name__ == "__main__":
    make(Path(__file__).parents[1] / "yobotics")
