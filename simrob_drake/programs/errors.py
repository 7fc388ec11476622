"""What can go wrong on the way of a move, as named exceptions; nothing has moved when one is raised."""

from simrob_drake.base.errors import SimrobError


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
        super().__init__(f"{where}: {axis} would be at {shown}")
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
        super().__init__(f"{where}: {axis} would {self._word} {shown}")
        self.axis, self.point, self.time, self.rate, self.duration = axis, point, time, rate, duration


class SpeedLimitExceeded(_TooFast):
    """A move on which a joint would turn faster than it can."""

    _word = "move at"


class AccelerationLimitExceeded(_TooFast):
    """A move on which a joint would be sped up, or slowed down, more than it can."""

    _word = "be sped up by"


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
        super().__init__(f"{where}: {axis} would need {shown}")
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
        advice = "the path leads through a singular posture; go there by move_j, or take another way"
        super().__init__(f"{where}: {axis} would have to jump by {shown} there: {advice}")
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
            f"{where}: {bodies[0]} would run into {bodies[1]}, {1e3 * depth:.1f} mm deep; check 'limits' lets it"
        )
        self.point, self.time, self.bodies, self.depth = point, time, bodies, depth


class NoFreePath(SimrobError):
    """A move around obstacles for which no way was found."""


class StartInCollision(NoFreePath):
    """A move around obstacles that would begin in one.

    Attributes:
        bodies: what is in what.
        depth: how deep [m].
    """

    def __init__(self, depth: float, bodies: tuple[str, str]) -> None:
        remedy = "go out of it by move_l or move_abs_j with check 'limits'"
        super().__init__(f"the start: {bodies[0]} is {1e3 * depth:.1f} mm deep in {bodies[1]}; {remedy}")
        self.bodies, self.depth = bodies, depth


class GoalInCollision(NoFreePath):
    """A goal of a move around obstacles that lies in one, with every posture that reaches it; attributes as above."""

    def __init__(self, target: str, count: int, depth: float, bodies: tuple[str, str]) -> None:
        """Say with how many postures, and of the best one what would be in what."""
        which = "the only posture" if count == 1 else f"all {count} postures"
        found = f"{bodies[0]} would be {1e3 * depth:.1f} mm deep in {bodies[1]}"
        super().__init__(f"{target} is in collision with {which} there: {found}{' at best' * (count > 1)}")
        self.bodies, self.depth = bodies, depth
