"""Loop that gets a fallen robot up by a sequence of postures.

After each posture the lean of the trunk is checked. If it is wrong, the sequence is tried again from the start. A
loop's output ``target`` replaces the reference of its robot while its output ``active`` is 1.
"""

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from simrob_drake.base.frames import Vector, vertical
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Integer
from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import ASKED, LoopSection
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.walking.getting_up import RisingPosture, load_getting_up, postures
from simrob_drake.walking.stride import smoothstep

# Lean of the trunk above which the robot has fallen [rad].
_FALLEN_LEAN = math.radians(60.0)
# Lean of the trunk below which the robot stands [rad].
_UPRIGHT_LEAN = math.radians(15.0)
# Height of the root below which the robot has fallen, as a part of the height at which it stands [1].
_FALLEN_HEIGHT = 0.7
# Time for which the robot must lie still before it begins [s].
_REST_TIME = 0.3
# Time for which the robot must stand before the loop ends [s].
_STANDING_TIME = 1.0
# Longest time that the loop waits for the robot to lie still, or to stand [s].
_PATIENCE = 2.0
# Largest component of the velocity of a robot at rest [m/s, rad/s].
_REST_SPEED = 0.2

# Stages of the loop.
# The robot has not fallen.
_UP = 0.0
# The loop waits until the robot lies still.
_DOWN = 1.0
# The first posture; the others have the numbers after it.
_FIRST = 2.0
STANDS = message("parts.stands", "stands")
"""Word in the reason of a run that ends well."""
Attempts = Annotated[Integer, Field(ge=1, le=100)]


class GetUp(LoopSection):
    """Get a robot up after it has fallen, by the postures under `get_up` in its `gaits.yaml`.

    When it has fallen, the robot holds its reference until it lies still. If the trunk's lean is wrong after a posture,
    the robot tries again from the start. When it stands, other loops drive it again.
    """

    label: ClassVar[str] = message("parts.loop_get_up", "get up")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_trunk", "Trunk\nlying, rising, standing"),
        message("parts.stage_next_posture", "Next posture\nor a new attempt"),
        message("parts.stage_way_to_posture", "Motion to the posture"),
    )

    kind: Literal["get_up"]
    attempts: Attempts = 5
    """Largest count of attempts; the run ends if none succeeds."""
    ends: Boolean = False
    """Whether the run ends once the robot has stood for a second."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot stands on feet of its own and has postures to get up, in addition to the base class.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not stand on feet of its own, or its postures are missing or invalid, beyond
                limits of axes, or name axes that it does not have; or by the checks of the base class the robot does
                not exist, the station has no servos, or the rate is too high.
        """
        super().check(key, station)
        model = self.on_feet(key, station).model
        _load_sequences(model)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""
        model = robot.model
        return Rising(
            self,
            _load_sequences(model),
            height=load_getting_up(model).height,
            facing=math.radians(gaits_file(model).facing_deg),
            ground=site.plant.ground,
            name=model.name,
        )


class RisingGoal(NamedTuple):
    """A posture on the way up.

    Attributes:
        posture: its duration, and the lean of the trunk that it must reach.
        angles: positions of the axes, shape (n,) [rad].
    """

    posture: RisingPosture
    angles: Vector


def _load_sequences(model: RobotModel) -> list[list[RisingGoal]]:
    """Load the postures with which a robot gets up.

    Returns:
        Two sequences: the one from lying on the front, then the one from lying on the back.

    Raises:
        SimrobError: the robot's files have no postures to get up, or the postures are invalid, beyond limits of axes,
            or name axes that it does not have.
    """
    getting_up = load_getting_up(model)
    sequences = list[list[RisingGoal]]()
    for sequence in (getting_up.front, getting_up.back):
        all_angles = postures(model, sequence)
        goals = [
            RisingGoal(posture, angles)
            for posture, angles in zip(sequence, all_angles, strict=True)
        ]
        sequences.append(goals)
    return sequences


class _Lean(NamedTuple):
    """Lean of a trunk.

    Attributes:
        ahead: lean ahead, -pi to pi [rad].
        total: lean to any side, 0 to pi [rad].
    """

    ahead: float
    total: float


class Rising(SampledBlock):
    """Compute the next posture of a robot that gets up.

    Ports:
        in  ``base_pose`` (7): x y z [m] and a quaternion; ``base_velocity`` (6) [m/s, rad/s]; ``asked`` (n) [rad].
        out ``target`` (n) [rad]; ``active`` (1): 1 from the fall until it stands; ``offset_velocity`` (n) [rad/s]:
        velocity of the target; ``attempt`` (1): count of attempts since it fell.
    """

    units = MappingProxyType({"target": "rad", "offset_velocity": "rad/s"})

    def __init__(
        self,
        section: GetUp,
        sequences: Sequence[Sequence[RisingGoal]],
        *,
        height: float,
        facing: float,
        ground: Ground,
        name: str,
    ) -> None:
        """Create the block.

        Args:
            section: section of the loop.
            sequences: postures from lying on the front, and from lying on the back.
            height: height of the root above the ground from which on the robot stands [m].
            facing: direction in which the robot looks, in the axes of its root, counterclockwise from x [rad].
            ground: ground of the station.
            name: name of the robot, for messages.
        """
        self._section = section
        self._sequences = sequences
        self._height = height
        self._ground = ground
        self._name = name
        self._ahead_x = math.cos(facing)
        self._ahead_y = math.sin(facing)
        zero = np.zeros(len(sequences[0][0].angles))
        outputs: dict[str, Vector | float] = {
            "target": zero,
            "active": 0.0,
            "offset_velocity": zero,
            "attempt": 0.0,
        }
        more_memory: dict[str, Vector | float] = {
            "stage": _UP,
            "origin": zero,  # target at the start of the stage [rad]
            "sequence": 0.0,  # index of the sequence: 0 from the front, 1 from the back
            "elapsed": 0.0,  # time since the start of the stage [s]
            "well": 0.0,  # time for which the robot has been at rest, or standing, without a break [s]
        }
        reads = {"base_pose": 7, "base_velocity": 6, ASKED: len(zero)}
        super().__init__(
            period=1 / section.rate,
            reads=reads,
            memory={**outputs, **more_memory},
            gives=tuple(outputs),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the next target, or change to the next stage.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.

        Raises:
            RunEnds: all attempts have failed; or the robot stands, and the run is to end then.
        """
        stage = memory["stage"][0]
        elapsed = memory["elapsed"][0] + self.period
        height = self._ground.height(read["base_pose"])
        lean = self._lean_of(read["base_pose"])
        if stage == _UP:
            # A robot that has sunk to its knees is upright, but low.
            has_fallen = lean.total > _FALLEN_LEAN or height < _FALLEN_HEIGHT * self._height
            return self._watch(read[ASKED], has_fallen=has_fallen)
        if stage == _DOWN:
            is_still = bool(np.abs(read["base_velocity"]).max() < _REST_SPEED)
            return self._lie(memory, elapsed, self._time_well(memory, is_well=is_still), lean.ahead)

        sequence = self._sequences[int(memory["sequence"][0])]
        # Index of the posture; after the last one it is their count.
        number = int(stage - _FIRST)
        if number < len(sequence):
            return self._rise(memory, elapsed, sequence[number], math.degrees(lean.ahead))
        # After the last posture the robot must also stay up.
        stands = lean.total < _UPRIGHT_LEAN and height > self._height
        return self._stand(memory, elapsed, self._time_well(memory, is_well=stands))

    def _lean_of(self, pose: Vector) -> _Lean:
        """Compute the lean of the trunk from the pose (7,) of the root: x y z [m], then the quaternion qw qx qy qz."""
        # The world's vertical in the axes of the root: it moves backward there as the trunk leans ahead.
        x, y, up = vertical(*pose[3:].tolist())
        ahead = -(x * self._ahead_x + y * self._ahead_y)
        # Rounding may lead beyond 1, of which there is no arc cosine.
        up_within_range = min(max(up, -1.0), 1.0)
        return _Lean(ahead=math.atan2(ahead, up), total=math.acos(up_within_range))

    def _time_well(self, memory: Named, *, is_well: bool) -> float:
        """Time [s] for which the robot has been at rest, or standing, up to this sample; 0 if ``is_well`` is False."""
        return float(memory["well"][0]) + self.period if is_well else 0.0

    def _watch(self, asked: Vector, *, has_fallen: bool) -> Changes:
        """Wait for a fall; then hold the reference ``asked`` (n,) [rad] of that moment. Nothing changes until then.

        Raises:
            RunEnds: the robot has not fallen, and the section ends the run once the robot stands.
        """
        # The attempts count from the fall: a robot that falls once more has all of them again.
        if has_fallen:
            return {"active": 1.0, "target": asked, "attempt": 0.0, **_begin(_DOWN, asked)}
        if self._section.ends:
            raise RunEnds(
                message(
                    "parts.stands_not_fallen",
                    "{name} {stands}: it has not fallen",
                    name=self._name,
                    stands=STANDS,
                )
            )
        return {}

    def _lie(self, memory: Named, elapsed: float, time_well: float, ahead: float) -> Changes:
        """Wait until the robot lies still, then count an attempt and begin the sequence for its side.

        Args:
            memory: memory before the sample.
            elapsed: time since the stage began [s].
            time_well: time for which the robot has been at rest [s].
            ahead: lean of the trunk ahead [rad]: positive if it lies on its front, negative on its back.
        """
        # A robot that rolls to and fro for too long begins all the same.
        if time_well < _REST_TIME and elapsed < _PATIENCE:
            return {"elapsed": elapsed, "well": time_well}
        is_on_back = ahead < 0
        sequence_index = float(is_on_back)
        attempt = memory["attempt"] + 1
        return {"attempt": attempt, "sequence": sequence_index, **_begin(_FIRST, memory["target"])}

    def _rise(self, memory: Named, elapsed: float, goal: RisingGoal, ahead_deg: float) -> Changes:
        """Move on to a posture. At its end, begin the next stage if the trunk's lean is right, or try again.

        Args:
            memory: memory before the sample.
            elapsed: time since the stage began [s].
            goal: the posture, with its duration and the range of leans that are right at its end.
            ahead_deg: lean of the trunk ahead [deg].

        Raises:
            RunEnds: the lean is wrong, and this was the last attempt.
        """
        # target = origin + s(elapsed / time) (angles - origin), with the smooth step s from 0 to 1.
        part = min(elapsed / goal.posture.time, 1.0)
        origin = memory["origin"]
        target = origin + smoothstep(part) * (goal.angles - origin)
        velocity = (target - memory["target"]) / self.period
        changes: dict[str, Vector | float] = {
            "target": target,
            "offset_velocity": velocity,
            "elapsed": elapsed,
        }
        if part < 1.0:
            return changes
        # A robot that has slipped or rolled over is in another posture than planned, and shows it by its lean.
        least, most = goal.posture.lean_deg
        if least <= ahead_deg <= most:
            return {**changes, **_begin(memory["stage"][0] + 1, target)}
        return {**changes, **self._try_again(memory, target)}

    def _stand(self, memory: Named, elapsed: float, time_well: float) -> Changes:
        """Wait until the robot has stood for long enough, and release it. If that takes too long, try again.

        Args:
            memory: memory before the sample.
            elapsed: time since the stage began [s].
            time_well: time for which the robot has stood [s].

        Raises:
            RunEnds: the robot stands, and the run is to end then; or it does not stand in time, and this was the last
                attempt.
        """
        if time_well < _STANDING_TIME:
            if elapsed < _PATIENCE:
                return {"elapsed": elapsed, "well": time_well}
            return self._try_again(memory, memory["target"])
        if self._section.ends:
            raise RunEnds(
                message(
                    "parts.stands_again",
                    "{name} {stands}: it got up at attempt {attempt}",
                    name=self._name,
                    stands=STANDS,
                    attempt=int(memory["attempt"][0]),
                )
            )
        # With `active` at 0, other loops drive the robot again.
        return {"active": 0.0, "stage": _UP}

    def _try_again(self, memory: Named, target: Vector) -> Changes:
        """Begin the stage in which the robot lies again, with the present target (n,) [rad], after a failed attempt.

        Raises:
            RunEnds: it was the last attempt.
        """
        # `_lie` counts an attempt when it begins, so this is the count of failed attempts.
        tries = int(memory["attempt"][0])
        if tries >= self._section.attempts:
            raise RunEnds(
                message(
                    "parts.lies",
                    "{name} did not get up in {tries} {tries:attempt|attempts}",
                    name=self._name,
                    tries=tries,
                )
            )
        return _begin(_DOWN, target)


def _begin(stage: float, origin: Vector) -> dict[str, Vector | float]:
    """Make the changes of the memory at the start of a stage, where the target is at rest.

    Args:
        stage: the stage.
        origin: target at that time, shape (n,) [rad].
    """
    return {
        "stage": stage,
        "origin": origin,
        "elapsed": 0.0,
        "well": 0.0,
        "offset_velocity": np.zeros(len(origin)),
    }
