"""Pieces change hands (SimRob's PegarEn): another parent, the same place in the world."""

from __future__ import annotations

from pydrake.math import RigidTransform

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.frames import PoseLike, as_transform, pose_from_transform
from simrob_drake.parts.site import WORLD
from simrob_drake.programs.model import StationModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import carriers_of


def reparented(
    model: StationModel, piece: str, parent: str, *, frame: str | None = None, pose: PoseLike | None = None
) -> StationConfig:
    """Return a station in which a piece hangs on something else.

    Args:
        model: of the station as it is, in its present posture.
        piece: which; it brings mass, centre of mass, inertia, colour, tool centre point, and what hangs on it.
        parent: ``world``, a robot (its flange), or a piece (its tool centre point).
        frame: a frame of the parent piece instead of its tool centre point; a tool of a robot instead of its first.
        pose: the piece's pose in the parent's frame; unless given it stays where it is in the world.

    Raises:
        UnknownName: no such piece, parent or frame.
        InvalidParameter: the piece itself as its parent, or one that hangs on it.
    """
    config = model.config
    if piece not in config.pieces:
        raise UnknownName("piece", piece, config.pieces)
    known = [WORLD, *config.robots, *config.pieces]
    if parent not in known:
        raise UnknownName("parent", parent, [name for name in known if name != piece])
    if frame is not None and parent == WORLD:
        raise InvalidParameter("frame", frame, "left out: the world has none")
    above = parent
    while above in config.pieces:
        if above == piece:
            wanted = "world, a robot, or a piece that does not hang on it"
            raise InvalidParameter(f"parent of {piece}", "the piece itself" if parent == piece else parent, wanted)
        above = model.resolved.pieces[above].parent
    mount = _mount_pose(model, parent, frame)
    place = mount.inverse() @ model.pose(model.piece_origin(piece)) if pose is None else as_transform(pose)
    entry = config.pieces[piece].model_copy(
        update={"parent": parent, "frame": frame, "pose": tuple(pose_from_transform(place).tolist())}
    )
    changed = config.model_copy(update={"pieces": {**config.pieces, piece: entry}})
    return _with_tools(model, changed, piece)


def _mount_pose(model: StationModel, parent: str, frame: str | None) -> RigidTransform:
    if parent == WORLD:
        return RigidTransform()
    if parent in model.config.pieces:
        return model.pose(model.piece_frame(parent) if frame is None else model.piece_frame(parent, frame))
    return model.pose(model.flange(parent, frame))


def _with_tools(model: StationModel, new: StationConfig, piece: str) -> StationConfig:
    """Let the robot that took a piece use its tool centre point, and one that gave its tool away what carried it."""
    old, carriers, robots = model.resolved.pieces, carriers_of(new), dict(new.robots)
    giver, taker = old[piece].carrier, carriers[piece]
    if giver == taker:
        return new
    if giver in robots:
        tool = model.tool_in_use(giver)
        if carriers.get(tool, giver) != giver:
            before = old[piece].parent
            flange = model.config.pieces[piece].frame or next(iter(model.robots[giver].model.tools), None)
            changes = {"tcp": before if before in new.pieces else flange, "tcp_offset": None}
        else:
            changes = {"tcp": tool or None}
        robots[giver] = robots[giver].model_copy(update=changes)
    if taker in robots:
        robots[taker] = robots[taker].model_copy(update={"tcp": piece, "tcp_offset": None})
    return new.model_copy(update={"robots": robots})
