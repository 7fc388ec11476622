"""Errors of moves that cannot be done. Nothing has moved when one of them is raised.

In all of them, `where` names the point of the move, such as "point 3 of 30 on the way to the target", and `shown` is a
text: a value in the user's unit, and what else the docstring of the constructor names. The other arguments are the
attributes of the class, in SI units.
"""

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message


class JointLimitExceeded(SimrobError):
    """Raised when a joint would leave its limits in a move.

    Attributes:
        axis: name of the joint.
        point: number of the point of the move, counted from 1. It is 0 for a gait, which has no points.
        time: time of the point since the start of the move [s].
        value: position of the joint there [rad or m].
    """

    def __init__(
        self, where: str, axis: str, *, point: int, time: float, value: float, shown: str
    ) -> None:
        """Make the error. The argument `shown` is the position and the limit with their units."""
        super().__init__(
            message(
                "programs.axis_would_be_at",
                "{where}: {axis} would be at {position}",
                where=where,
                axis=axis,
                position=shown,
            )
        )
        # Numbers for programs that react to the error: the message has them in the units of the user.
        self.axis = axis
        self.point = point
        self.time = time
        self.value = value


class _TooFast(SimrobError):
    """Raised when a joint or the tool would exceed a limit of its speed, or a joint one of its acceleration, in a move.

    Attributes:
        axis: name of the joint, or "the tool".
        point: number of the point of the move, counted from 1.
        time: time of the point since the start of the move [s].
        rate: speed or acceleration of the joint or the tool there [rad/s or m/s, or rad/s² or m/s²].
        duration: duration in which the whole move would keep this kind of limit, with a margin of 2 % [s].
    """

    # The words between "would" and the rate in the message; a subclass sets them.
    _word = ""

    def __init__(
        self,
        where: str,
        axis: str,
        *,
        point: int,
        time: float,
        rate: float,
        duration: float,
        shown: str,
    ) -> None:
        """Make the error. The argument `shown` is the rate with its unit, its limit and an advice."""
        super().__init__(
            message(
                "programs.axis_would",
                "{where}: {axis} would {word} {rate}",
                where=where,
                axis=axis,
                word=self._word,
                rate=shown,
            )
        )
        self.axis = axis
        self.point = point
        self.time = time
        self.rate = rate
        self.duration = duration


class SpeedLimitExceeded(_TooFast):
    """Raised when a joint would move faster than it can, or the tool faster than its rated speed."""

    # The message continues with the speed: "waist would move at 120.0 deg/s".
    _word = message("programs.move_at", "move at")


class AccelerationLimitExceeded(_TooFast):
    """Raised when a joint would speed up or slow down more than it can."""

    # The message continues with the acceleration.
    _word = message("programs.be_sped_up_by", "accelerate at")


class TorqueLimitExceeded(SimrobError):
    """Raised when a motor could not even hold its joint at rest in a move.

    Attributes:
        axis: name of the joint.
        point: number of the point of the move, counted from 1.
        time: time of the point since the start of the move [s].
        torque: torque or force that holds the joint there [N·m or N].
    """

    def __init__(
        self, where: str, axis: str, *, point: int, time: float, torque: float, shown: str
    ) -> None:
        """Make the error. The argument `shown` is the torque with its unit, its limit and an advice."""
        super().__init__(
            message(
                "programs.axis_would_need",
                "{where}: {axis} would need {torque}",
                where=where,
                axis=axis,
                torque=shown,
            )
        )
        # The torque belongs to the posture at rest: no slower move needs less.
        self.axis = axis
        self.point = point
        self.time = time
        self.torque = torque


class BrokenPath(SimrobError):
    """Raised when the points of a path can be reached, but only with a jump of the axes between two of them.

    Attributes:
        axis: name of the joint that jumps most.
        point: number of the point of the move before the jump, counted from 1.
        jump: motion of this joint between the two points [rad or m].
    """

    def __init__(self, where: str, axis: str, *, point: int, jump: float, shown: str) -> None:
        """Make the error. The argument `shown` is the jump with its unit, without a limit or an advice."""
        # Two postures near a singular one reach nearly the same pose, and are far from each other.
        advice = message(
            "programs.singular_path",
            "the path passes through a singular posture; use move_j, or another path",
        )
        super().__init__(
            message(
                "programs.axis_would_jump",
                "{where}: {axis} would have to jump by {jump} there: {advice}",
                where=where,
                axis=axis,
                jump=shown,
                advice=advice,
            )
        )
        self.axis = axis
        self.point = point
        self.jump = jump


class PathCollision(SimrobError):
    """Raised when bodies would collide in a move.

    Attributes:
        point: number of the point of the move, counted from 1.
        time: time of the point since the start of the move [s].
        bodies: names of the two bodies, the moving one first.
        depth: depth of their overlap [m].
    """

    def __init__(
        self, where: str, *, point: int, time: float, bodies: tuple[str, str], depth: float
    ) -> None:
        """Make the error; see the attributes of the class."""
        # Depths are a few millimetres, so messages show millimetres. The attribute stays in metres.
        super().__init__(
            message(
                "programs.would_run_into",
                "{where}: {body} would collide with {other}, {depth:.1f} mm deep; "
                "`check: limits` in the move leaves out this check",
                where=where,
                body=bodies[0],
                other=bodies[1],
                depth=1e3 * depth,
            )
        )
        self.point = point
        self.time = time
        self.bodies = bodies
        self.depth = depth

    def add_lost_piece(self, piece: str, move: str) -> None:
        """Add to the message that fingers lost a piece before, which is likely the obstacle.

        Args:
            piece: name of the piece.
            move: name of the move in which it slipped out of the fingers.
        """
        self.message = message(
            "programs.after_lost_piece",
            "{problem}; before that, {piece} slipped out of the fingers in {move}",
            problem=self.message,
            piece=piece,
            move=move,
        )
        # `str()` of an exception and its traceback show the arguments, not the attribute.
        self.args = (self.message,)


class NoFreePath(SimrobError):
    """Raised when no path was found for a move around obstacles."""


class StartInCollision(NoFreePath):
    """Raised when bodies overlap at the start of a move around obstacles.

    Attributes:
        bodies: names of the two bodies, the moving one first.
        depth: depth of their overlap [m].
    """

    def __init__(self, depth: float, bodies: tuple[str, str]) -> None:
        """Make the error; see the attributes of the class."""
        # A search needs a free start. These moves follow a path that the user sees, and may begin in a collision.
        remedy = message(
            "programs.go_out_with_limits",
            "leave the collision by move_l or move_abs_j with `check: limits`",
        )
        super().__init__(
            message(
                "programs.start_in_collision",
                "the start is in collision: {body} overlaps {other} by {depth:.1f} mm; {remedy}",
                body=bodies[0],
                depth=1e3 * depth,
                other=bodies[1],
                remedy=remedy,
            )
        )
        self.bodies = bodies
        self.depth = depth


class GoalInCollision(NoFreePath):
    """Raised when bodies overlap in every posture that was tried as the goal of a move around obstacles.

    Attributes:
        bodies: names of two bodies that overlap in the best posture, the moving one first.
        depth: depth of their overlap [m].
    """

    def __init__(self, target: str, count: int, depth: float, bodies: tuple[str, str]) -> None:
        """Make the error.

        Args:
            target: name of the target.
            count: count of postures that were tried, at least 1. All of them reach the target.
            depth: depth of the deepest overlap in the posture where this depth is least [m].
            bodies: names of the two bodies of this overlap, the moving one first.
        """
        has_several = count > 1
        # Each posture counts with its deepest overlap. Of several postures, the message describes the one where this
        # overlap is least deep.
        which = message("programs.the_only_posture", "the only posture that reaches it")
        if has_several:
            which = message(
                "programs.all_postures", "all {count} postures that reach it", count=count
            )
        overlap = message(
            "programs.would_be_deep_in",
            "{body} would overlap {other} by {depth:.1f} mm",
            body=bodies[0],
            depth=1e3 * depth,
            other=bodies[1],
        )
        super().__init__(
            message(
                "programs.target_in_collision",
                "{target} is in collision in {which}: {found}{at_best}",
                target=target,
                which=which,
                found=overlap,
                at_best=message("programs.at_best", " in the best of them") if has_several else "",
            )
        )
        self.bodies = bodies
        self.depth = depth
