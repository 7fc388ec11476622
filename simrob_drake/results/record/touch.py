"""Contacts of a run: when bodies begin to touch, how deep bodies overlap, and how far feet slide over the ground.

All of this is computed after the run. When bodies begin to touch is read from Drake's contact results at the solver's
steps. Overlaps and slides are computed from positions at *looks*: evenly spaced samples of the run.

An overlap is measured between collision shapes, whatever the contact model is. With hydroelastic contact, the contact
surface is as deep as the two shapes are in each other.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple, TypeAlias

import numpy as np
from pydrake.geometry import GeometryId, QueryObject
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context

from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import Message, message
from simrob_drake.blocks.contacts import pressing_pairs
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR, owner_and_robot
from simrob_drake.robots.feet import FootContact
from simrob_drake.stations.config import StationConfig

FASTEST = 50.0
"""Largest rate of the looks [Hz]. A look takes some 50 µs."""

_MOST_STEPS = 4000
"""Largest count of steps of a run at which contact results are evaluated."""

_TIME_APART = 0.1
"""Two bodies must have been apart for this time before they begin to touch again [s]: a body that trembles on the floor
touches it once."""

_WORLD = "world"
"""Name of Drake's world body, to which the ground belongs."""

BodyPair: TypeAlias = frozenset[str]
"""Names of two bodies in contact; a single name if both bodies have the same name."""

ShapePair: TypeAlias = frozenset[GeometryId]
"""Two collision shapes in contact."""


class Event(NamedTuple):
    """Something that happened in a run.

    Attributes:
        time: when it happened [s].
        text: what happened, in a few words.
    """

    time: float
    text: str


def onsets(
    station: StationPlant,
    step_times: Vector,
    contacts_at: Callable[[Vector], Iterator[ContactResults]],
) -> Iterator[Event]:
    """Yield an event whenever two bodies begin to touch with a force, in the order of time.

    Bodies that touch at the start of the run have no event there. Bodies that touch again have an event only if they
    were apart for more than 0.1 s. In a run of more than 4000 steps, only every k-th step is looked at.

    Args:
        station: the plant of the run.
        step_times: ends of the solver's steps, with the start of the run first, shape (m,) [s].
        contacts_at: yields Drake's contact results at times (k,) [s].
    """
    steps_per_evaluation = math.ceil(len(step_times) / _MOST_STEPS)
    evaluated_times = step_times[::steps_per_evaluation]
    start = step_times[0]
    last_contact: dict[BodyPair, float] = {}  # time at which each pair was last seen in contact [s]
    pairs_before: set[BodyPair] = set()
    for time, results in zip(evaluated_times.tolist(), contacts_at(evaluated_times), strict=True):
        pairs = {_bodies_of(station, shapes) for shapes in pressing_pairs(results)}
        # Sets have no order. Sorting makes the events of two equal runs equal.
        for pair in sorted(pairs - pairs_before, key=sorted):
            # A pair that never touched before has been apart for ever.
            time_apart = time - last_contact.get(pair, -np.inf)
            if time > start and time_apart > _TIME_APART:
                yield Event(time, _touch_in_words(pair))
        # The time is kept while a contact lasts, so that it is the end of the contact once the bodies part.
        last_contact.update(dict.fromkeys(pairs, time))
        pairs_before = pairs


def _touch_in_words(pair: BodyPair) -> Message:
    """Write a sentence about a contact: a body touches the ground, or two bodies touch each other."""
    bodies = sorted(pair - {_WORLD})
    if _WORLD in pair:
        return message("results.body_touches", "{body} touches the ground", body=bodies[0])
    # If both bodies have the same name, as links of two equal robots, the first name is also the last one.
    return message(
        "results.body_touches_other", "{body} touches {other}", body=bodies[0], other=bodies[-1]
    )


def _bodies_of(station: StationPlant, shapes: Sequence[GeometryId]) -> BodyPair:
    """Names of the bodies to which two collision shapes belong."""
    # Shapes are fixed to frames, and each frame to a body.
    inspector = station.scene_graph.model_inspector()
    frames = [inspector.GetFrameId(shape) for shape in shapes]
    return frozenset(str(station.plant.GetBodyFromFrameId(frame).name()) for frame in frames)


class StanceSlide(NamedTuple):
    """Slide of a foot in a *stance*, a time in which the foot touches the ground without interruption.

    Attributes:
        distance: distance that the foot slid during the stance [m].
        last_look: index of the look at which the stance ended. It is 0 if there is no stance to choose: the run has
            only one look, or the foot was not in contact at the start and has not slid.
    """

    distance: float
    last_look: int


@dataclass(frozen=True)
class Slide:
    """Slides of one foot over the ground. An *interval* is the time between two looks that follow each other.

    Attributes:
        distances: distance that the foot slid in each interval, shape (m - 1,) for m looks [m]; 0 if it was not in
            contact.
        in_contact: whether, in each interval, one and the same point of the foot touched the ground at both ends, shape
            (m - 1,). A foot that touched with one point before, and with another one after, does not count.
    """

    distances: Vector
    in_contact: Flags

    @property
    def total(self) -> float:
        """Distance that the foot slid in the whole run [m]."""
        return float(self.distances.sum())

    @cached_property
    def longest(self) -> StanceSlide:
        """The stance in which the foot slid farthest; the first of several equal ones.

        If the foot has not slid at all, it may be a stance without any interval, before the first look.
        """
        # Each interval without contact begins a new stance, so its number is the count of such intervals so far. The
        # interval itself adds nothing to the distance.
        stance_of_interval = np.cumsum(~self.in_contact)
        distances = np.bincount(stance_of_interval, self.distances, minlength=1)
        stance = distances.argmax()
        # Interval i ends at look i + 1, so the count of intervals up to the end is the index of the last look.
        last_look = int(np.searchsorted(stance_of_interval, stance, side="right"))
        return StanceSlide(distance=float(distances[stance]), last_look=last_look)


class DeepestOverlap(NamedTuple):
    """The deepest overlap of two bodies. Overlaps are compared by their depth first.

    Attributes:
        depth: how far one body is inside of the other [m].
        time: when [s].
    """

    depth: float
    time: float


class OverlappingBodies(NamedTuple):
    """Names of two bodies that overlap, in alphabetical order; the floor is the second one.

    Attributes:
        first: name of a piece, of a robot's link, or of a box of a terrain.
        second: such a name, or ``floor``.
    """

    first: str
    second: str


class FootName(NamedTuple):
    """Name of a foot in a station.

    Attributes:
        robot: name of the robot.
        link: name of the link that is the foot.
    """

    robot: str
    link: str


@dataclass(frozen=True)
class Touch:
    """Overlaps and slides of a run.

    Attributes:
        times: times of the looks, shape (m,) [s].
        rate: rate of the looks [Hz].
        depths: the deepest overlap of each pair of bodies. At each look only the deepest overlap of all bodies counts,
            so that pairs without the deepest overlap at some look have no entry.
        slides: slides of each foot of the robots that can walk.
    """

    times: Vector
    rate: float
    depths: dict[OverlappingBodies, DeepestOverlap] = field(default_factory=dict)
    slides: dict[FootName, Slide] = field(default_factory=dict)


def evaluate_touch(
    config: StationConfig,
    station: StationPlant,
    samples: Vector,
    positions_at: Callable[[Vector], Vector],
    context_of: Callable[[], Context] | None,
) -> Touch:
    """Compute overlaps and slides of a run.

    Overlaps are left out for stations without contact forces, slides for robots that cannot walk.

    Args:
        config: configuration of the station in the run.
        station: the plant of the run.
        samples: times of the run's samples, shape (m,) [s]. Some or all of them become looks.
        positions_at: computes positions of the plant (k, nq) at times (k,) [s].
        context_of: makes a context of the diagram that contains the plant; None if there is no diagram. Overlaps are
            then left out.
    """
    # A whole count of samples, so that each look is at a sample: positions are exact there.
    samples_per_look = int(np.ceil(config.sample_rate / FASTEST))
    times = samples[::samples_per_look]
    rate = config.sample_rate / samples_per_look
    # Looks take time, so none is made for stations without feet and contacts.
    walkers = robots_that_can_walk(config, station)
    root = context_of() if config.has_contact_forces and context_of is not None else None
    if not walkers and root is None:
        return Touch(times, rate)

    positions = positions_at(times)
    depths = {} if root is None else _deepest_overlaps(station, times, positions, root)
    slides: dict[FootName, Slide] = {}
    for robot in walkers:
        slides |= _slides_of(robot, station, positions)
    return Touch(times, rate, depths, slides)


def _deepest_overlaps(
    station: StationPlant, times: Vector, positions: Vector, root: Context
) -> dict[OverlappingBodies, DeepestOverlap]:
    """Find the deepest overlaps, by pair of bodies: at each look only the deepest of all overlaps counts.

    Args:
        station: the plant of the run.
        times: times of the looks, shape (m,) [s].
        positions: positions of the plant at the looks, shape (m, nq).
        root: context of the diagram that contains the plant; it may be changed.
    """
    if station.replaced_pairs:
        # Boxes that touch by contact points at their corners are measured as whole boxes.
        root = station.with_whole_shapes(root)
    # By shapes first: naming their bodies is slow, and a few pairs of shapes occur at thousands of looks.
    of_shapes: dict[ShapePair, DeepestOverlap] = {}
    for time, row in zip(times.tolist(), positions, strict=True):
        station.set_positions(root, row)
        _keep_deepest(of_shapes, station.query(root), time)

    of_bodies: dict[OverlappingBodies, DeepestOverlap] = {}
    for shapes, overlap in of_shapes.items():
        bodies = _overlapping_bodies(station, shapes)
        deepest = of_bodies.get(bodies, overlap)
        of_bodies[bodies] = max(deepest, overlap)
    return of_bodies


def _keep_deepest(
    overlaps: dict[ShapePair, DeepestOverlap], query: QueryObject, time: float
) -> None:
    """Enter the deepest overlap of one look into a dict, if it is the deepest one so far of its pair of shapes.

    Args:
        overlaps: the deepest overlaps so far, which are changed.
        query: Drake's query object, with all bodies at their poses of this look.
        time: time of the look [s].
    """
    penetrations = query.ComputePointPairPenetration()
    if not penetrations:
        return
    deepest = max(penetrations, key=attrgetter("depth"))
    pair = frozenset((deepest.id_A, deepest.id_B))
    if pair not in overlaps or overlaps[pair].depth < deepest.depth:
        overlaps[pair] = DeepestOverlap(deepest.depth, time)


def _overlapping_bodies(station: StationPlant, shapes: ShapePair) -> OverlappingBodies:
    """Names of the bodies to which two shapes belong: pieces, links, the floor or boxes of a terrain."""
    names = [owner_and_robot(station, shape)[0] for shape in shapes]
    # In alphabetical order, but for the floor: False comes before True, so the floor is the last one.
    first, second = sorted(names, key=lambda name: (name == FLOOR, name))
    return OverlappingBodies(first, second)


def _slides_of(
    robot: StationRobot, station: StationPlant, positions: Vector
) -> dict[FootName, Slide]:
    """Compute how each foot of a robot slides. Returns an empty dict if the robot has no feet.

    Args:
        robot: the robot.
        station: the plant with the robot.
        positions: positions of the plant at the looks, shape (m, nq).
    """
    feet = robot.feet
    if feet is None:
        return {}
    plant = station.plant
    context = plant.CreateDefaultContext()
    frames = [plant.GetFrameByName(link, robot.instance) for link in feet.links]
    # of each foot's link in the world, at each look
    poses = np.empty((len(frames), len(positions), 4, 4))
    for look, row in enumerate(positions):
        plant.SetPositions(context, row)
        for foot, frame in enumerate(frames):
            poses[foot, look] = frame.CalcPoseInWorld(context).GetAsMatrix4()

    slides = {}
    for link, poses_of_link in zip(feet.links, poses, strict=True):
        slides[FootName(robot.name, link)] = _slide(feet, link, station.ground, poses_of_link)
    return slides


def _slide(feet: FootContact, link: str, ground: Ground, poses: Vector) -> Slide:
    r"""Compute how a foot slides over the ground.

    The *contact points* of a foot are the lowest points of its contact shapes: of each sphere, or of each corner of
    the sole. A contact point touches if it is below the surface of the ground. Let :math:`p` be a contact point that
    touches at two looks, and :math:`R, t` the link's pose at the first look and :math:`R', t'` at the second. The link
    has moved this point by

    .. math:: d = t' + R' R^T (p - t) - p.

    The foot slides by the length of the part of :math:`d` along the floor, on average over the points that touch. So a
    foot that rolls does not slide.

    In the shapes below, m is the count of looks and k the count of contact points of the foot.

    Args:
        feet: the contact shapes of the robot's feet.
        link: name of the link that is the foot.
        ground: the ground, whose floor may be inclined.
        poses: poses of the link in the world at the looks, shape (m, 4, 4).
    """
    # Poses in the floor's axes, whose z axis is normal to the floor. Both frames have the same origin.
    floor_to_world = ground.floor_pose.rotation().matrix()
    poses_in_floor = np.array(poses)
    # The transpose of the rotation turns world axes to floor axes; "ji" sums over the rows, as the transpose does.
    poses_in_floor[:, :3] = np.einsum("ji,mjk->mik", floor_to_world, poses[:, :3])
    rotations = poses_in_floor[:, :3, :3]
    origins = poses_in_floor[:, :3, 3]

    # d in the floor's axes, shape (m - 1, k, 3). Keep the order of the arithmetic: results are equal to the last bit.
    points = feet.lowest_points(link, poses_in_floor)  # (m, k, 3)
    points_in_link = np.einsum(
        "mji,mkj->mki", rotations[:-1], points[:-1] - origins[:-1, np.newaxis]
    )
    points_after = origins[1:, np.newaxis] + np.einsum(
        "mij,mkj->mki", rotations[1:], points_in_link
    )
    displacements = points_after - points[:-1]

    # A point slides from one look to the next if it touches at both.
    points_in_world = points.reshape(-1, 3) @ floor_to_world.T
    is_below = points_in_world[:, 2] < ground.beneath(points_in_world)
    is_below = is_below.reshape(points.shape[:2])
    is_touching = is_below[:-1] & is_below[1:]

    # Only x and y in the floor's axes: motion along the normal is sinking in, not sliding.
    distances = np.linalg.norm(displacements[..., :2], axis=2) * is_touching
    # at least 1: without contact the mean is 0, not NaN
    touching_count = np.maximum(is_touching.sum(axis=1), 1)
    return Slide(
        distances=distances.sum(axis=1) / touching_count, in_contact=is_touching.any(axis=1)
    )


def robots_that_can_walk(config: StationConfig, station: StationPlant) -> list[StationRobot]:
    """Robots of a station that have feet, a base that moves freely, and joints that are moved by torques.

    Empty for a kinematic station, which prescribes the joints.
    """
    if not config.engine.moves_by_forces:
        return []
    return [
        robot
        for robot in station.robots.values()
        if robot.feet is not None and robot.model.base == "floating"
    ]
