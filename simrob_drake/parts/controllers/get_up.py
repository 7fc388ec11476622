"""A loop that gets a fallen robot up: posture after posture, each as the trunk lies as it should after the last."""

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from simrob_drake.base.frames import Vector, vertical
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Boolean, Integer
from simrob_drake.blocks.sampled import Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import ASKED, LoopSection
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import Surroundings
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.walking.getting_up import RisingPosture, load_getting_up, postures
from simrob_drake.walking.stride import smoothstep

_FALLEN, _UPRIGHT = math.radians(60.0), math.radians(15.0)  # lean of the trunk [rad]
_LOW = 0.7  # of the height at which it stands
_REST, _STANDS, _PATIENCE = 0.3, 1.0, 2.0  # how long it must lie still, or stand, and how long that is waited for [s]
_SLOW = 0.2  # a robot at rest [m/s, rad/s]
_UP, _DOWN, _FIRST = 0.0, 1.0, 2.0
"""Stages: it has not fallen; it waits until it lies still; the first posture, which the others follow."""
STANDS = message("parts.stands", "stands")
"""What a run says that ends well."""
Attempts = Annotated[Integer, Field(ge=1, le=100)]


class GetUp(LoopSection):
    """Get a robot up where it has fallen, by the postures under `get_up` in its `gaits.yaml`; then let go.

    As soon as it has fallen it holds what it was asked for, until it lies still. Where the trunk does not lie after a
    posture as it should, it begins anew.
    """

    label: ClassVar[str] = message("parts.loop_get_up", "get up")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_trunk", "Trunk\nlies, rises, stands"),
        message("parts.stage_next_posture", "Next posture\nor anew"),
        message("parts.stage_way_to_posture", "Way to the posture"),
    )

    kind: Literal["get_up"]
    attempts: Attempts = 5
    """How often it tries; the run ends where none succeeds."""
    ends: Boolean = False
    """Whether the run ends as soon as it has stood for a second."""

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot stands on feet of its own and has postures for it.

        Raises SimrobError: it does not, it has none, or what every loop checks.
        """
        super().check(key, station)
        model = self.on_feet(key, station).model
        own = load_getting_up(model)
        for way in (own.front, own.back):
            postures(model, way)

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        model = robot.model
        own, facing = load_getting_up(model), math.radians(gaits_file(model).facing_deg)
        ways = [list(zip(way, postures(model, way), strict=True)) for way in (own.front, own.back)]
        return Rising(self, ways, own.height, facing=facing, ground=site.plant.ground, name=model.name)


class Rising(SampledBlock):
    """Ask a robot that has fallen for the next posture on its way up.

    Ports:
        in  ``base_pose`` (7): x y z [m] and a quaternion; ``base_velocity`` (6) [m/s, rad/s]; ``asked`` (n) [rad].
        out ``target`` (n) [rad]; ``active`` (1): 1 from the fall until it stands; ``offset_velocity`` (n) [rad/s]: how
        fast the target moves; ``attempt`` (1): how often it has begun since it fell.
    """

    units = MappingProxyType({"target": "rad", "offset_velocity": "rad/s"})

    def __init__(
        self,
        section: GetUp,
        ways: Sequence[Sequence[tuple[RisingPosture, Vector]]],
        height: float,
        *,
        facing: float,
        ground: Ground,
        name: str,
    ) -> None:
        """Make the block of a section, for a robot of a name, which stands from a ``height`` of its root [m] on.

        The ``ways`` from the belly and from the back are postures and their angles (n,) [rad]; ``facing`` is where the
        robot looks in the axes of its root, counterclockwise from x [rad].
        """
        self._section, self._ways, self._height, self._ground, self._name = section, ways, height, ground, name
        self._ahead = math.cos(facing), math.sin(facing)
        zero = np.zeros(len(ways[0][0][1]))
        outputs: dict[str, Vector | float] = {"target": zero, "active": 0.0, "offset_velocity": zero, "attempt": 0.0}
        # where the way to a posture begins; which of the ways; how long it has been in this stage, and
        # without a break at rest, or standing [s]
        memory = {**outputs, "stage": _UP, "origin": zero, "way": 0.0, "elapsed": 0.0, "well": 0.0}
        reads = {"base_pose": 7, "base_velocity": 6, ASKED: len(zero)}
        super().__init__(period=1 / section.rate, reads=reads, memory=memory, gives=tuple(outputs))

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next point of the way to a posture, or what follows that."""
        stage, pose, elapsed = memory["stage"][0], read["base_pose"], memory["elapsed"][0] + self.period
        height, (ahead, lean) = self._ground.height(pose), self._leans(pose)
        if stage == _UP:
            return self._upright(read[ASKED], fallen=lean > _FALLEN or height < _LOW * self._height)
        if stage == _DOWN:
            still = bool(np.abs(read["base_velocity"]).max() < _SLOW)
            return self._lying(memory, elapsed, self._lasting(memory, well=still), ahead)
        way = self._ways[int(memory["way"][0])]
        if stage - _FIRST < len(way):
            return self._rising(memory, elapsed, *way[int(stage - _FIRST)], math.degrees(ahead))
        return self._standing(memory, elapsed, self._lasting(memory, well=lean < _UPRIGHT and height > self._height))

    def _leans(self, pose: Vector) -> tuple[float, float]:
        """Return how far the trunk leans ahead, -pi to pi, and to any side, 0 to pi [rad]."""
        x, y, up = vertical(*pose[3:].tolist())
        return math.atan2(-(x * self._ahead[0] + y * self._ahead[1]), up), math.acos(min(max(up, -1.0), 1.0))

    def _lasting(self, memory: Named, *, well: bool) -> float:
        return float(memory["well"][0]) + self.period if well else 0.0

    def _upright(self, asked: Vector, *, fallen: bool) -> Changes:
        if not fallen and self._section.ends:
            raise RunEnds(
                message("parts.stands_not_fallen", "{name} {stands}: it has not fallen", name=self._name, stands=STANDS)
            )
        return {"active": 1.0, "target": asked, "attempt": 0.0, **_begin(_DOWN, asked)} if fallen else {}

    def _lying(self, memory: Named, elapsed: float, well: float, ahead: float) -> Changes:
        """Wait until it lies still, and begin by how it lies."""
        if well < _REST and elapsed < _PATIENCE:
            return {"elapsed": elapsed, "well": well}
        return {"attempt": memory["attempt"] + 1, "way": float(ahead < 0), **_begin(_FIRST, memory["target"])}

    def _rising(self, memory: Named, elapsed: float, posture: RisingPosture, goal: Vector, ahead_deg: float) -> Changes:
        """Go on to a posture, and from there to the next if the trunk lies as it should."""
        share, (least, most) = min(elapsed / posture.time, 1.0), posture.lean_deg
        target = memory["origin"] + smoothstep(share) * (goal - memory["origin"])
        speed = (target - memory["target"]) / self.period
        changed: dict[str, Vector | float] = {"target": target, "offset_velocity": speed, "elapsed": elapsed}
        if share < 1.0:
            return changed
        well = least <= ahead_deg <= most
        return {**changed, **(_begin(memory["stage"][0] + 1, target) if well else self._anew(memory, target))}

    def _standing(self, memory: Named, elapsed: float, well: float) -> Changes:
        """Let go once it has stood for long enough."""
        if well < _STANDS:
            return {"elapsed": elapsed, "well": well} if elapsed < _PATIENCE else self._anew(memory, memory["target"])
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
        return {"active": 0.0, "stage": _UP}

    def _anew(self, memory: Named, target: Vector) -> Changes:
        tries = int(memory["attempt"][0])
        if tries >= self._section.attempts:
            raise RunEnds(
                message(
                    "parts.lies", "{name} lies: it did not get up in {tries} attempts", name=self._name, tries=tries
                )
            )
        return _begin(_DOWN, target)


def _begin(stage: float, origin: Vector) -> dict[str, Vector | float]:
    """Return what changes in the memory where a stage begins."""
    return {"stage": stage, "origin": origin, "elapsed": 0.0, "well": 0.0, "offset_velocity": np.zeros(len(origin))}
