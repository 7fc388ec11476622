"""What can go wrong on the way of a move, as named exceptions; nothing has moved when one is raised."""

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message


class JointLimitExceeded(SimrobError):
    """A move on which a joint would leave its limits.

    Attributes:
        axis: the joint.
        point: which point of the move, counted from 1.
        time: when on the move [s].
        value: where the joint would be [rad or m].
    """

    def __init__(self, where: str, axis: str, *, point: int, time: float, value: float, shown: str) -> None:
        """Say at which point which axis would be where; ``shown`` tells the value and the limits with their units."""
        super().__init__(
            message(
                "programs.axis_would_be_at",
                "{where}: {axis} would be at {position}",
                where=where,
                axis=axis,
                position=shown,
            )
        )
        self.axis, self.point, self.time, self.value = axis, point, time, value


class _TooFast(SimrobError):
    """A move on which a joint would exceed a limit of its motion.

    Attributes:
        axis: the joint.
        point: which point of the move, counted from 1.
        time: when on the move [s].
        rate: what it would take [rad/s or m/s, or by s²].
        duration: in what time the whole move can be done [s].
    """

    _word = ""

    def __init__(
        self, where: str, axis: str, *, point: int, time: float, rate: float, duration: float, shown: str
    ) -> None:
        """Say at which point which axis would be too fast, what its limit is, and what would do."""
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
        self.axis, self.point, self.time, self.rate, self.duration = axis, point, time, rate, duration


class SpeedLimitExceeded(_TooFast):
    """A move on which a joint would turn faster than it can."""

    _word = message("programs.move_at", "move at")


class AccelerationLimitExceeded(_TooFast):
    """A move on which a joint would be sped up, or slowed down, more than it can."""

    _word = message("programs.be_sped_up_by", "be sped up by")


class TorqueLimitExceeded(SimrobError):
    """A move on which a motor could not even hold its joint still.

    Attributes:
        axis: the joint.
        point: point of the move, counted from 1.
        time: when on the move [s].
        torque: that holds the joint there [N·m or N].
    """

    def __init__(self, where: str, axis: str, *, point: int, time: float, torque: float, shown: str) -> None:
        """Say at which point which axis needs too much; ``shown`` has the torque, the limit and the remedy."""
        super().__init__(
            message(
                "programs.axis_would_need", "{where}: {axis} would need {torque}", where=where, axis=axis, torque=shown
            )
        )
        self.axis, self.point, self.time, self.torque = axis, point, time, torque


class BrokenPath(SimrobError):
    """A path whose points can be reached, but not one after the other: the arm would have to jump between postures.

    Attributes:
        axis: the joint that jumps most.
        point: the point of the move before the jump, counted from 1.
        jump: how far the joint jumps [rad or m].
    """

    def __init__(self, where: str, axis: str, *, point: int, jump: float, shown: str) -> None:
        """Say between which points which axis would have to jump; ``shown`` tells how far with its unit."""
        advice = message(
            "programs.singular_path",
            "the path leads through a singular posture; go there by move_j, or take another way",
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
        self.axis, self.point, self.jump = axis, point, jump


class PathCollision(SimrobError):
    """A move on which the robot would run into something.

    Attributes:
        point: which point of the move, counted from 1.
        time: when on the move [s].
        bodies: what touches what.
        depth: how deep one goes into the other [m].
    """

    def __init__(self, where: str, *, point: int, time: float, bodies: tuple[str, str], depth: float) -> None:
        """Say at which point what runs into what, and how deep."""
        super().__init__(
            message(
                "programs.would_run_into",
                "{where}: {body} would run into {other}, {depth:.1f} mm deep; `check: limits` in the move allows it",
                where=where,
                body=bodies[0],
                other=bodies[1],
                depth=1e3 * depth,
            )
        )
        self.point, self.time, self.bodies, self.depth = point, time, bodies, depth

    def add_lost_piece(self, piece: str, move: str) -> None:
        """Add to the message that fingers lost a piece before, which is likely what the robot would run into.

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
        self.args = (self.message,)


class NoFreePath(SimrobError):
    """A move around obstacles for which no way was found."""


class StartInCollision(NoFreePath):
    """A move around obstacles that would begin in one.

    Attributes:
        bodies: what is in what.
        depth: how deep [m].
    """

    def __init__(self, depth: float, bodies: tuple[str, str]) -> None:
        remedy = message("programs.go_out_with_limits", "go out of it by move_l or move_abs_j with `check: limits`")
        super().__init__(
            message(
                "programs.start_in_collision",
                "the start: {body} is {depth:.1f} mm deep in {other}; {remedy}",
                body=bodies[0],
                depth=1e3 * depth,
                other=bodies[1],
                remedy=remedy,
            )
        )
        self.bodies, self.depth = bodies, depth


class GoalInCollision(NoFreePath):
    """A goal of a move around obstacles that lies in one, with every posture that reaches it; attributes as above."""

    def __init__(self, target: str, count: int, depth: float, bodies: tuple[str, str]) -> None:
        """Say with how many postures, and of the best one what would be in what."""
        which = (
            message("programs.the_only_posture", "the only posture")
            if count == 1
            else message("programs.all_postures", "all {count} postures", count=count)
        )
        found = message(
            "programs.would_be_deep_in",
            "{body} would be {depth:.1f} mm deep in {other}",
            body=bodies[0],
            depth=1e3 * depth,
            other=bodies[1],
        )
        super().__init__(
            message(
                "programs.target_in_collision",
                "{target} is in collision with {which} there: {found}{at_best}",
                target=target,
                which=which,
                found=found,
                at_best=message("programs.at_best", " at best") * (count > 1),
            )
        )
        self.bodies, self.depth = bodies, depth
