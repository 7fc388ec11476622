"""Joints, with limits, springs, starts and ports that drive and sense, and the poses of Rigid Transforms."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import count
from math import inf, isfinite

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake.base.frames import Vector, has_wrong_norm, rotation_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.extensions.simulink.tables import table


@dataclass(frozen=True)
class Pull:
    """What acts along or about one axis of the base of a floating joint."""

    place: int  # 0 to 2 of a force along x, y, z; 3 to 5 of a torque about them
    port: int  # the left port of its signal; 0 without
    stiffness: float  # of its spring
    rest: float  # of its spring
    damping: float  # of its damper
    stops: tuple[tuple[float, float, float], ...] = ()
    """Of a force, a place beyond which a spring pushes back, which way (1 up, -1 down), and how stiff it is."""

    def __bool__(self) -> bool:
        return bool(self.port or self.stiffness or self.damping or self.stops)


def _against_turning(node: Node, prefix: str) -> list[Pull]:
    """Return what resists turning in all directions alike: a spring, by angle and axis, and a damper."""
    damping = node.number(f"{prefix}DampingCoefficient", unit="N*m*s/rad")
    stiffness = node.number(f"{prefix}SpringStiffness", unit="N*m/rad")
    slack = [
        node.text(name)
        for name in node.block.parameters
        if "Equilibrium" in name and "Method" in name
    ]
    if stiffness and any(method not in ("None", "") for method in slack):
        node.note(
            "lost",
            message(
                "simulink.spring_against_turning",
                "its spring against turning: only one that is slack where both frames are one is read",
            ),
        )
        stiffness = 0.0
    return [Pull(3 + place, 0, stiffness, 0.0, damping) for place in range(3)]


AXES = {f"{sign}{name}": factor * row + 0.0 for sign, factor in (("+", 1.0), ("-", -1.0)) for name, row in
        zip("XYZ", np.eye(3), strict=True)}  # fmt: skip
"""Directions by name, each of shape (3,)."""
_TURNS = {
    "X": RotationMatrix.MakeXRotation,
    "Y": RotationMatrix.MakeYRotation,
    "Z": RotationMatrix.MakeZRotation,
}


def rigid_transform(node: Node) -> RigidTransform:
    """Return X_BF of a Rigid Transform block; the offset is resolved in the base frame.

    Raises InvalidModel: a method or figure that cannot be.
    """
    method, offset = node.text("TranslationMethod", "None"), np.zeros(3)
    if method == "Cartesian":
        offset = node.numbers("TranslationCartesianOffset", "[0 0 0]", unit="m", size=3)
    elif method == "StandardAxis":
        offset = axis(node, "TranslationStandardAxis") * node.number(
            "TranslationStandardOffset", unit="m"
        )
    elif method == "Cylindrical":
        radius = node.number("TranslationROffset", unit="m")
        angle = node.number("TranslationThetaOffset", unit="rad")
        offset = np.array(
            [
                radius * np.cos(angle),
                radius * np.sin(angle),
                node.number("TranslationZOffset", unit="m"),
            ]
        )
    elif method != "None":
        raise node.refusal(
            message(
                "simulink.unknown_translation",
                "has the unknown translation method '{method}'",
                method=method,
            )
        )
    return RigidTransform(rotation(node), offset)


def rotation(node: Node, prefix: str = "") -> RotationMatrix:
    """Return R_BF of a block's rotation parameters; joints have them with a prefix, such as ``PositionTarget``.

    Raises InvalidModel: a method or figure that cannot be.
    """
    if (method := node.text(f"{prefix}RotationMethod", "None")) not in _ROTATIONS:
        raise node.refusal(
            message(
                "simulink.unknown_rotation",
                "has the unknown rotation method '{method}'",
                method=method,
            )
        )
    return _ROTATIONS[method](node, prefix)


def _aligned(node: Node, prefix: str) -> RotationMatrix:
    base, follower = list[Vector](), list[Vector]()
    for names, found in ((f"{prefix}BaseAlignAxis", base), (f"{prefix}FollAlignAxis", follower)):
        one, other = axis(node, f"{names}A"), axis(node, f"{names}B")
        if abs(one @ other) > 0.5:
            raise node.refusal(
                message(
                    "simulink.along_one_line",
                    "{names}A and {names}B are along one line; two axes span a frame",
                    names=names,
                )
            )
        found += [one, other, np.cross(one, other)]
    return RotationMatrix(np.transpose(base) @ np.array(follower))


def _matrix(node: Node, prefix: str) -> RotationMatrix:
    matrix = node.numbers(f"{prefix}RotationMatrix", "[1 0 0;0 1 0;0 0 1]", size=9).reshape(3, 3)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) or np.linalg.det(matrix) < 0:
        raise node.refusal(
            message(
                "simulink.matrix_no_rotation",
                "its {prefix}RotationMatrix is no rotation: not orthonormal and right-handed",
                prefix=prefix,
            )
        )
    return RotationMatrix.ProjectToRotationMatrix(matrix)


def _quaternion(node: Node, prefix: str) -> RotationMatrix:
    quaternion = node.numbers(f"{prefix}Quaternion", "[1 0 0 0]", size=4)
    if np.linalg.norm(quaternion) < 1e-9:
        raise node.refusal(
            message("simulink.quaternion_is_zero", "its {prefix}Quaternion is zero", prefix=prefix)
        )
    if has_wrong_norm(quaternion):
        norm = np.linalg.norm(quaternion)
        node.note(
            "repaired",
            message(
                "simulink.quaternion_norm",
                "its {prefix}Quaternion has a norm of {norm:.6g}; it is normalised",
                prefix=prefix,
                norm=norm,
            ),
        )
    return rotation_of(quaternion)


def axis(node: Node, name: str) -> Vector:
    """Return the direction that a parameter such as ``+Z`` names."""
    text = node.text(name, "+Z")
    if text not in AXES:
        raise node.refusal(
            message(
                "simulink.one_of_axes",
                "{name} is '{text}'; it must be one of {axes}",
                name=name,
                text=text,
                axes=", ".join(AXES),
            )
        )
    return AXES[text]


def _about(node: Node, direction: Vector, prefix: str) -> RotationMatrix:
    length, angle = (
        float(np.linalg.norm(direction)),
        node.number(f"{prefix}RotationAngle", unit="rad"),
    )
    if length < 1e-9 and angle:
        raise node.refusal(
            message("simulink.turns_about_zero", "turns about an axis of length zero")
        )
    return RotationMatrix(AngleAxis(angle, direction / length)) if angle else RotationMatrix()


def _sequence(node: Node, prefix: str) -> RotationMatrix:
    letters = node.text(f"{prefix}RotationSequence", "XYZ")
    if len(letters) != 3 or any(letter not in _TURNS for letter in letters):
        raise node.refusal(
            message(
                "simulink.rotation_sequence",
                "has the rotation sequence '{letters}'; it must be three axes such as ZYX",
                letters=letters,
            )
        )
    angles = node.numbers(f"{prefix}RotationSequenceAngles", "[0 0 0]", unit="rad", size=3)
    turns = [_TURNS[letter](angle) for letter, angle in zip(letters, angles, strict=True)]
    if node.text(f"{prefix}RotationSequenceAxes", "FollowerAxes") == "BaseAxes":
        turns.reverse()  # about fixed axes the later turn stands to the left
    return turns[0] @ turns[1] @ turns[2]


_ROTATIONS: dict[str, Callable[[Node, str], RotationMatrix]] = {
    "None": lambda *_: RotationMatrix(),
    "StandardAxis": lambda node, to: _about(node, axis(node, f"{to}RotationStandardAxis"), to),
    "ArbitraryAxis": lambda node, to: _about(
        node, node.numbers(f"{to}RotationArbitraryAxis", "[0 0 1]", size=3), to
    ),
    "AlignedAxes": _aligned,
    "RotationSequence": _sequence,
    "RotationMatrix": _matrix,
    "Quaternion": _quaternion,
}


PRIMITIVES: dict[str, list[str]] = table("joints")["primitives"]
JOINTS = PRIMITIVES.keys()
ANGLE = "Angle Constraint"  # which is read as a joint of all that it leaves free

_HARDEST, _HARD_LAG = 1e8, 1e-3
"""N/m or N·m/rad: the stiffest stop that a solver gets through, and how long its damper takes for its spring [s]: what
leans on it with 1000 N or N·m goes 10 µm or µrad in."""
_COUNTS = {"High": 1e-2, "Low": 3e-4}
"""How much a target counts that a joint asks for, by its priority; what nobody asks for counts 1e-5."""


@dataclass(eq=False)
class Freedom:
    """One degree of freedom."""

    name: str  # unique in the model once it is put together
    turns: bool  # whether it turns [rad] or slides [m]
    axis: Vector  # shape (3,), in the base frame
    lower: float = -inf  # limits; infinite without
    upper: float = inf
    damping: float = 0.0  # [N·m·s/rad or N·s/m]
    stiffness: float = 0.0  # of its spring
    rest: float = 0.0  # where the spring is slack
    start: float | None = None  # position at the beginning; None if not asked for
    start_speed: float | None = None  # speed at the beginning; likewise
    start_counts: float = (
        1e-5  # how much the start counts against the others, where a loop cannot have them all
    )
    speed_counts: float = 1e-5  # how much the speed does
    driven: str = "free"  # ``torque`` or ``motion`` if a signal drives it, or ``free``
    stop: tuple[float, float] | None = (
        None  # stiffness and damping at the limits; None without limits
    )


@dataclass(eq=False)
class Joint:
    """A joint block."""

    node: Node
    freedoms: list[Freedom] = field(default_factory=list)  # from base to follower
    floating: bool = False  # whether it leaves all six free, as nothing would
    start: RigidTransform = field(default_factory=RigidTransform)
    """Pose of the follower in the base of a floating joint at the beginning."""
    start_speed: Vector = field(default_factory=lambda: np.zeros(6))
    """Of its origin, then how fast it turns, in the base's axes, shape (6,) [m/s, rad/s]."""
    inputs: dict[int, tuple[Freedom, str]] = field(default_factory=dict)
    """Which freedom an input port drives, and how: by the number of the left port."""
    outputs: dict[int, tuple[Freedom, str]] = field(default_factory=dict)
    """Which freedom an output port senses, and what of it: by the number of the right port."""
    senses: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Of a floating joint, which parts of a frame sensor a right port hands out; none of what is not measured."""
    pulls: list[Pull] = field(default_factory=list)
    """What acts on the follower of a floating joint or a ball, and backwards on its base."""
    screw: dict[Freedom, float] = field(default_factory=dict)
    """How much each freedom counts in a sum of positions that is 0; empty without."""
    tilt: RigidTransform = field(default_factory=RigidTransform)
    """Pose of the follower's frame in the one that the freedoms move."""


def read_joint(node: Node) -> Joint:
    """Return what a joint block is; raises InvalidModel: figures that cannot be, or a joint without a likeness here."""
    if node.text("JointMode", "Normal") not in ("Normal", "Locked", ""):
        raise node.refusal(
            message(
                "simulink.unread_mode",
                "is in the mode {mode}; Normal and Locked are read",
                mode=node.text("JointMode"),
            )
        )
    joint = Joint(node)
    kinds = PRIMITIVES[node.kind]
    moved = any(node.text(f"{kind}MotionActuationMode") == "InputMotion" for kind in kinds)
    if node.kind == "6-DOF Joint" and not moved:
        _read_floating(node, joint)
        return joint
    _read_primitives(node, joint, kinds)
    for freedom in (one for one in joint.freedoms if one.driven == "motion"):
        # limits push nothing whose motion is given
        freedom.lower, freedom.upper, freedom.stop = (
            -inf,
            inf,
            None,
        )
    if node.kind == "Lead Screw Joint":
        _read_screw(node, joint)
    if node.kind == ANGLE:
        _read_angle(node, joint)
    return joint


def _read_angle(node: Node, joint: Joint) -> None:
    """Read an angle that is kept between two axes z: all that it leaves free is a joint, which starts anywhere."""
    kept = {"Parallel": 0.0, "Antiparallel": np.pi, "Perpendicular": np.pi / 2}
    chosen = node.text("ConstraintType", "Parallel")
    angle = kept[chosen] if chosen in kept else node.number("Angle", "45*pi/180", unit="rad")
    joint.tilt = RigidTransform(_TURNS["X"](angle), np.zeros(3))
    if 0.0 < angle < np.pi:
        joint.freedoms.append(
            Freedom(f"{node.path}_Rt", True, joint.tilt.rotation().matrix()[:, 2])
        )
    for freedom in joint.freedoms:
        freedom.start_counts = 0.0


def _read_primitives(node: Node, joint: Joint, kinds: list[str]) -> None:
    """Read what each primitive of a joint lets free, and number its ports."""
    left, right = 2, 2
    for kind in kinds:
        prefix = "" if len(kinds) == 1 else kind
        if kind.startswith("S"):
            joint.freedoms += _ball(node, prefix)
            joint.pulls = list(filter(None, _against_turning(node, prefix)))
            left += sum(node.is_on(f"{prefix}ActuateTorque{end}") for end in ("X", "Y", "Z", ""))
            right += sum(node.is_on(f"{prefix}{sensed}") for sensed in table("joints")["ball"])
            continue
        joint.freedoms.append(freedom := _freedom(node, kind, prefix))
        for what in ("Torque", "Motion"):
            if node.text(f"{prefix}{what}ActuationMode") == f"Input{what}":
                freedom.driven = what.lower()
                joint.inputs[left] = (freedom, freedom.driven)
                left += 1
        for sensed, what in table("joints")["sensed"].items():
            if node.is_on(f"{prefix}{sensed}"):
                joint.outputs[right] = (freedom, what)
                right += 1


def _read_screw(node: Node, joint: Joint) -> None:
    """Read what a lead screw has of its own: its lead, and targets and ports of the turn or the way."""
    turn, way = joint.freedoms
    hand = 1.0 if node.text("Direction", "RightHand") == "RightHand" else -1.0
    joint.screw = {way: 1.0, turn: -hand * node.number("Lead", "1", unit="m/rad")}
    ports = count(2)
    for freedom, name in ((turn, "Rotation"), (way, "Translation")):
        sensed = {"Position": "q", "Velocity": "w", "Acceleration": "a"}
        joint.outputs |= {next(ports): (freedom, what) for quantity, what in sensed.items()
                          if node.is_on(f"Sense{name}{quantity}")}  # fmt: skip
        length = "rad" if freedom.turns else "m"
        for quantity, unit in (("Position", length), ("Velocity", f"{length}/s")):
            asked = node.is_on(f"{quantity}TargetSpecify")
            if asked and node.is_on(f"{quantity}TargetRotationBased") == freedom.turns:
                _ask(
                    node,
                    "",
                    freedom,
                    quantity,
                    node.number(f"{quantity}Target{name}Value", unit=unit),
                )


def _freedom(node: Node, kind: str, prefix: str) -> Freedom:
    turns = kind.startswith("R")
    length, effort = ("rad", "N*m") if turns else ("m", "N")
    axis = AXES[f"+{kind[1].upper()}"]
    freedom = Freedom(node.path + (f"_{kind}" if prefix else ""), turns, axis)
    freedom.damping = node.number(f"{prefix}DampingCoefficient", unit=f"{effort}*s/{length}")
    freedom.stiffness = node.number(f"{prefix}SpringStiffness", unit=f"{effort}/{length}")
    freedom.rest = (
        node.number(f"{prefix}EquilibriumPosition", unit=length) if freedom.stiffness else 0.0
    )
    if min(freedom.damping, freedom.stiffness) < 0:
        raise node.refusal(message("simulink.negative_spring", "has a negative spring or damper"))
    for quantity, unit in (("Position", length), ("Velocity", f"{length}/s")):
        if node.is_on(f"{prefix}{quantity}TargetSpecify"):
            _ask(
                node,
                prefix,
                freedom,
                quantity,
                node.number(f"{prefix}{quantity}TargetValue", unit=unit),
            )
    _read_stops(node, prefix, freedom, effort, length)
    return freedom


def _read_stops(node: Node, prefix: str, freedom: Freedom, effort: str, length: str) -> None:
    stops = []
    for end in ("Lower", "Upper"):
        if node.is_on(f"{prefix}{end}LimitSpecify"):
            setattr(freedom, end.lower(), node.number(f"{prefix}{end}LimitBound", unit=length))
            # Simulink's own figures are those of a degree
            scale = "*180/pi" if freedom.turns else ""
            stiffness = node.number(
                f"{prefix}{end}LimitStiffness", f"1e4{scale}", unit=f"{effort}/{length}"
            )
            damping = node.number(
                f"{prefix}{end}LimitDamping", f"10{scale}", unit=f"{effort}*s/{length}"
            )
            if stiffness <= 0 or damping < 0:
                raise node.refusal(
                    message(
                        "simulink.stiffness_of_limit",
                        "the stiffness of its {end} limit is not positive, or its damping negative",
                        end=end.lower(),
                    )
                )
            if stiffness > _HARDEST:
                node.note(
                    "approximated",
                    message(
                        "simulink.hard_stop",
                        "its stop of {stiffness:g} {effort}/{length} is one of {hardest:g}",
                        stiffness=stiffness,
                        effort=effort,
                        length=length,
                        hardest=_HARDEST,
                    ),
                )
            stops.append((min(stiffness, _HARDEST), min(damping, _HARDEST * _HARD_LAG)))
    freedom.stop = max(stops, default=None)
    if len(set(stops)) > 1:
        node.note(
            "approximated",
            message(
                "simulink.stops_differ", "its stops differ: both get the figures of the stiffer one"
            ),
        )
    if freedom.lower >= freedom.upper and node.findings.assume and node.findings.undefined:
        freedom.lower, freedom.upper, freedom.stop = -inf, inf, None
        node.note(
            "defaulted",
            message("simulink.unknown_limits", "its limits are unknown: none are taken"),
        )
    if freedom.lower >= freedom.upper:
        raise node.refusal(
            message(
                "simulink.limits_order",
                "its lower limit {lower:g} is not below its upper one, {upper:g}",
                lower=freedom.lower,
                upper=freedom.upper,
            )
        )


def _ask(node: Node, prefix: str, freedom: Freedom, quantity: str, value: float) -> None:
    counts = _COUNTS.get(node.text(f"{prefix}{quantity}TargetPriority"), _COUNTS["High"])
    if quantity == "Position":
        freedom.start, freedom.start_counts = value, counts
    else:
        freedom.start_speed, freedom.speed_counts = value, counts


def _ball(node: Node, prefix: str) -> list[Freedom]:
    """Return a ball joint as three turns about x, y and z."""
    node.note(
        "approximated",
        message(
            "simulink.ball_as_three_turns",
            "ball joint as three turns about x, y and z: singular where the middle one is at 90°",
        ),
    )
    turns = [
        Freedom(f"{node.path}_R{letter}", True, AXES[f"+{letter.upper()}"]) for letter in "xyz"
    ]
    if any(node.is_on(f"{prefix}{end}LimitSpecify") for end in ("Lower", "Upper")):
        node.note("lost", message("simulink.limits_of_ball", "the limits of a ball joint"))
    turn, rates = _ball_targets(node, prefix)
    if node.is_on(f"{prefix}PositionTargetSpecify"):
        for freedom, angle in zip(turns, xyz_angles(turn), strict=True):
            freedom.start, freedom.start_counts = angle, _COUNTS["High"]
    if node.is_on(f"{prefix}VelocityTargetSpecify"):
        first, middle, _ = (
            about(one.start or 0.0) for about, one in zip(_TURNS.values(), turns, strict=True)
        )
        axes = np.column_stack(
            [turns[0].axis, first @ turns[1].axis, first @ middle @ turns[2].axis]
        )
        for freedom, speed in zip(turns, np.linalg.solve(axes, rates), strict=True):
            freedom.start_speed, freedom.speed_counts = float(speed), _COUNTS["High"]
    return turns


def _ball_targets(node: Node, prefix: str) -> tuple[RotationMatrix, Vector]:
    """Return how a ball is turned at the start, and how fast it turns in the axes of its base, shape (3,) [rad/s]."""
    turn, rates = RotationMatrix(), np.zeros(3)
    if node.is_on(f"{prefix}PositionTargetSpecify"):
        turn = rotation(node, f"{prefix}PositionTarget")
    if node.is_on(f"{prefix}VelocityTargetSpecify"):
        rates = node.numbers(f"{prefix}VelocityTargetValue", "[0 0 0]", unit="rad/s", size=3)
        rates = (
            turn @ rates
            if node.text(f"{prefix}VelocityTargetInFollowerFrame", "on") == "on"
            else rates
        )
    return turn, rates


def xyz_angles(turn: RotationMatrix) -> tuple[float, float, float]:
    """Return the angles of turns about x, then the new y, then the new z [rad]."""
    matrix = turn.matrix()
    middle = np.arcsin(np.clip(matrix[0, 2], -1.0, 1.0))
    first, last = np.arctan2(-matrix[1, 2], matrix[2, 2]), np.arctan2(-matrix[0, 1], matrix[0, 0])
    return float(first), float(middle), float(last)


def _read_floating(node: Node, joint: Joint) -> None:
    """Read a joint that leaves all free: where it starts, what acts along its base's axes, and what it senses."""
    joint.floating, pulls, ports = True, [], iter(range(2, 8))
    slides = [_freedom(node, kind, kind) for kind in ("Px", "Py", "Pz")]
    for place, (one, letter) in enumerate(zip(slides, "xyz", strict=True)):
        ends = ((one.lower, 1.0), (one.upper, -1.0)) if one.stop else ()
        stops = tuple(
            (bound, way, one.stop[0]) for bound, way in ends if one.stop and isfinite(bound)
        )
        if stops:
            node.note(
                "approximated",
                message(
                    "simulink.stops_along",
                    "its stops along {letter} are springs without dampers",
                    letter=letter,
                ),
            )
        port = next(ports) if node.text(f"P{letter}TorqueActuationMode") == "InputTorque" else 0
        pulls.append(Pull(place, port, one.stiffness, one.rest, one.damping, stops))
    turn, rates = _ball_targets(node, "Sph")
    joint.start = RigidTransform(turn, [one.start or 0.0 for one in slides])
    joint.start_speed = np.array([*(one.start_speed or 0.0 for one in slides), *rates])
    for pull, letter in zip(_against_turning(node, "Sph"), "XYZ", strict=True):
        pulls.append(
            replace(pull, port=next(ports) if node.is_on(f"SphActuateTorque{letter}") else 0)
        )
    joint.pulls = list(filter(None, pulls))
    asked = (
        tuple(parts) for name, parts in table("joints")["floating"].items() if node.is_on(name)
    )
    joint.senses = dict(enumerate(asked, start=2))
