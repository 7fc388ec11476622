"""When bodies began to touch; how deep they were in each other, and how far feet slid, by positions at sampled moments.

For depths, shapes are asked for points of overlap, whatever the contact model is: a surface of pressure is as deep as
its bodies are in each other.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter

import numpy as np
import numpy.typing as npt
from pydrake.geometry import GeometryId, QueryObject
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import Message, message
from simrob_drake.blocks.contacts import pressing_pairs
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR, owner_and_robot
from simrob_drake.stations.config import StationConfig

FASTEST = 50.0
"""How often it is looked what touches, at most [Hz]: a look takes some 50 µs, half as much as a robot that stands."""


_LOOKS = 4000  # at most so many steps of a run are asked what touches what
_APART = 0.1  # s that two bodies are apart before they touch again: what trembles touches once

Event = tuple[float, str]  # when [s], and what in a few words


def onsets(
    station: StationPlant, step_times: Vector, contacts_at: Callable[[Vector], Iterator[ContactResults]]
) -> Iterator[Event]:
    """Yield when bodies begin to touch that were apart, but for those that touch from the start."""
    steps = step_times[:: -(-len(step_times) // _LOOKS)]
    touched: dict[frozenset[str], float] = {}
    before: set[frozenset[str]] = set()
    for time, results in zip(steps.tolist(), contacts_at(steps), strict=True):
        pairs = {frozenset(_body(station, shape) for shape in pair) for pair in pressing_pairs(results)}
        for pair in sorted(pairs - before, key=sorted):
            if time > step_times[0] and time - touched.get(pair, -np.inf) > _APART:
                yield time, _touch_in_words(sorted(pair - {"world"}))
        touched |= dict.fromkeys(pairs, time)
        before = pairs


def _touch_in_words(bodies: Sequence[str]) -> Message:
    """Say that one body touches the other, or that a single body touches the ground."""
    if len(bodies) == 1:
        return message("results.body_touches", "{body} touches", body=bodies[0])
    return message("results.body_touches_other", "{body} touches {other}", body=bodies[0], other=bodies[-1])


def _body(station: StationPlant, shape: GeometryId) -> str:
    frame = station.scene_graph.model_inspector().GetFrameId(shape)
    return str(station.plant.GetBodyFromFrameId(frame).name())


@dataclass(frozen=True)
class Slide:
    """How a foot slid over the ground between looks: ways (m,) [m], and whether it touched all the while, (m,)."""

    ways: Vector
    touching: npt.NDArray[np.bool_]

    @property
    def total(self) -> float:
        """All of its way over the ground [m]."""
        return float(self.ways.sum())

    @cached_property
    def longest(self) -> tuple[float, int]:
        """Its longest way between two steps [m], and at which look that ended."""
        stances = np.cumsum(~self.touching)
        ways = np.bincount(stances, self.ways, minlength=1)
        stance = ways.argmax()
        return float(ways[stance]), int(np.searchsorted(stances, stance, side="right"))


@dataclass(frozen=True)
class Touch:
    """What touched what in a run."""

    times: Vector  # when it was looked, shape (m,) [s]
    rate: float  # how often [Hz]
    # how deep two bodies were in each other [m] and when [s], by their names; of the deepest of each moment
    depths: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    slides: dict[tuple[str, str], Slide] = field(default_factory=dict)  # of each foot, by robot and link

    @classmethod
    def of(
        cls,
        config: StationConfig,
        station: StationPlant,
        samples: Vector,
        positions_at: Callable[[Vector], Iterable[Vector]],
        context_of: Callable[[], Context] | None,
    ) -> "Touch":
        """Look at a run, at its samples or some of them; parameters are as those of a recorded run."""
        every = int(np.ceil(config.sample_rate / FASTEST))
        times, rate = samples[::every], config.sample_rate / every
        walkers = legged(config, station)
        pressed = config.has_contact_forces and context_of is not None
        if not (walkers or pressed):
            return cls(times, rate)
        plant = station.plant
        root = None if context_of is None else context_of()
        if root is not None and station.replaced_pairs:
            root = station.with_whole_shapes(root)
        context = plant.CreateDefaultContext()
        links = [(robot, link) for robot in walkers if robot.feet is not None for link in robot.feet.links]
        frames = [plant.GetFrameByName(link, robot.instance) for robot, link in links]
        poses, depths = np.empty((len(frames), len(times), 4, 4)), dict[frozenset[GeometryId], tuple[float, float]]()
        for row, (time, positions) in enumerate(zip(times.tolist(), positions_at(times), strict=True)):
            plant.SetPositions(context, positions)
            for foot, frame in enumerate(frames):
                poses[foot, row] = frame.CalcPoseInWorld(context).GetAsMatrix4()
            if pressed and root is not None:
                station.set_positions(root, positions)
                _keep_deepest(station.query(root), time, depths)
        slides = {
            (robot.name, link): _slide(robot, link, station.ground, own)
            for (robot, link), own in zip(links, poses, strict=True)
        }
        return cls(times, rate, _by_body(station, depths), slides)


def _keep_deepest(query: QueryObject, time: float, depths: dict[frozenset[GeometryId], tuple[float, float]]) -> None:
    found = query.ComputePointPairPenetration()
    if found:
        deepest = max(found, key=attrgetter("depth"))
        pair = frozenset((deepest.id_A, deepest.id_B))
        if pair not in depths or depths[pair][0] < deepest.depth:
            depths[pair] = deepest.depth, time


def _by_body(
    station: StationPlant, depths: dict[frozenset[GeometryId], tuple[float, float]]
) -> dict[tuple[str, str], tuple[float, float]]:
    found: dict[tuple[str, str], tuple[float, float]] = {}
    for pair, deepest in depths.items():
        names = [owner_and_robot(station, shape)[0] for shape in pair]
        first, second = sorted(names, key=lambda name: (name == FLOOR, name))
        found[first, second] = max(found.get((first, second), deepest), deepest)
    return found


def _slide(robot: StationRobot, link: str, ground: Ground, poses: Vector) -> Slide:
    """Return how a foot slid whose link went through poses, shape (m, 4, 4).

    A foot touches with those points of its contact shapes, lowest over the floor, that lie below the ground's surface.
    From one look to the next each point that touches in both is followed as a point of its link, and the foot slides
    by the mean of their displacements along the floor. A foot that rolls does not slide.
    """
    assert robot.feet is not None  # the caller asks for robots with feet only
    to_world = ground.floor_pose.rotation().matrix()
    seen = np.array(poses)
    seen[:, :3] = np.einsum("ji,mjk->mik", to_world, poses[:, :3])  # in the floor's axes; its origin is the world's
    turns, places = seen[:, :3, :3], seen[:, :3, 3]
    points = robot.feet.lowest_points(link, seen)
    local = np.einsum("mji,mkj->mki", turns[:-1], points[:-1] - places[:-1, np.newaxis])
    moved = places[1:, np.newaxis] + np.einsum("mij,mkj->mki", turns[1:], local)
    in_world = points.reshape(-1, 3) @ to_world.T
    below = (in_world[:, 2] < ground.beneath(in_world)).reshape(points.shape[:2])
    touches = below[:-1] & below[1:]
    ways = np.linalg.norm((moved - points[:-1])[..., :2], axis=2) * touches
    return Slide(ways.sum(axis=1) / np.maximum(touches.sum(axis=1), 1), touches.any(axis=1))


def legged(config: StationConfig, station: StationPlant) -> list[StationRobot]:
    """Return the robots that could walk: with feet, a free base and joints that are moved by torque."""
    if not config.engine.moves_by_forces:
        return []
    return [robot for robot in station.robots.values() if robot.feet is not None and robot.model.base == "floating"]
