"""What a robot with legs can be told to do: moves of joints, gaits, walks by command, pieces in its hands."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import PoseLike, as_transform, finite, pose_from_transform
from simrob_drake.parts.site import WORLD
from simrob_drake.programs.legged_gait import step_moves
from simrob_drake.programs.legged_geometry import LeggedGeometry
from simrob_drake.programs.moves import (
    GO_TIME,
    MOVE_TIME,
    Act,
    ActMove,
    Attach,
    AttachMove,
    Go,
    GoMove,
    LegMove,
    Release,
    ReleaseMove,
    Walk,
    WalkMove,
    checked,
    move_of,
)
from simrob_drake.results.result import SimulationResult


class LeggedMoves(LeggedGeometry):
    """The moves of a robot with legs, each done at once and perhaps stored at the end of its program.

    Attributes of :class:`LeggedGeometry`.
    """

    @abstractmethod
    def _do(self, moves: Sequence[LegMove], *, store: bool = False) -> list[SimulationResult]:
        """Do moves from the last state, perhaps store them, and return the runs."""

    def test_move(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store nothing (TestMove); :meth:`undo` goes back to before it.

        Args:
            target_deg: where axes go [deg], by name or alias.
            duration: how long it takes [s].

        Raises:
            UnknownName: no such axis; proposes the nearest.
            JointLimitExceeded: tells which axis, and by how much.
            InvalidParameter: an angle that is no number, or a duration that is not positive.
        """
        return self._do([move_of(target_deg, duration)])[-1]

    def add_move(self, target_deg: Mapping[str, float], duration: float = MOVE_TIME) -> SimulationResult:
        """Move from the last state, and store the move at the end of the program (AddMove).

        A run that diverges or in which the robot falls is not stored. Arguments and errors are those of
        :meth:`test_move`.
        """
        return self._do([move_of(target_deg, duration)], store=True)[-1]

    def step(self, move_time: float | None = None) -> SimulationResult:
        """Go one step ahead, and store it (Paso).

        A robot whose ``gaits.yaml`` has a sequence ``step``, as the humanoid of MATLAB, goes through its postures by
        moves of joints: the step of the thesis with the left leg, four moves (p. 94), made for its large feet. The
        others take one step of the first gait for their feet, of full length, and bring their feet together.

        Args:
            move_time: of each of the moves [s], 1 in the thesis; or of each step of the gait. Their own unless given.

        Raises:
            InvalidParameter: a robot without legs or gaits, without a gait for its feet, or a time that is not
                positive.
            SimrobError: as :meth:`walk`.
        """
        return self._do(step_moves(self.model, self.worn_feet, move_time), store=True)[-1]

    def walk(
        self,
        steps: int,
        amplitude: float = 1.0,
        gait: str | None = None,
        *,
        store: bool = False,
        **changes: Any,
    ) -> SimulationResult:
        """Walk from the last state (Marcha).

        The robot first takes the posture in which its gait begins, in up to 2.5 s; if it stands so, it walks at once.
        Servos and floor are those of the gait while it walks, and steps of the solver are 10 ms at most; the floor
        stays as large as it had to become.

        Args:
            steps: how many step lengths ahead; the steps of the ramps (``ramp_steps``) and the last one, which brings
                the feet together, come in addition. Legs in turn for a crawl.
            amplitude: scales the length of the steps and, where the gait has them, way sideways and turn; of a march,
                how far all joints go.
            gait: a walk, trot, crawl or march of the robot's ``gaits.yaml``; the first for its feet unless given.
            store: at the end of the program.
            changes: other parameters of the gait to change, such as ``step_time``.

        Raises:
            InvalidParameter: a robot without gaits, other feet or another station than the gait needs, or parameters
                that cannot be.
            UnknownName: no such gait, or no such parameter of it; proposes the nearest.
            InvalidConfig: a parameter that cannot be.
            OutOfReach, JointLimitExceeded: steps that the legs cannot do; tells by how much.
        """
        walk = checked(Walk, steps=steps, amplitude=amplitude, gait=gait, **changes)
        return self._do([WalkMove(walk=walk)], store=store)[-1]

    def go(
        self,
        ahead: float = 0.0,
        sideways: float = 0.0,
        turn: float = 0.0,
        duration: float = GO_TIME,
        *,
        strict: bool = False,
        store: bool = False,
    ) -> SimulationResult:
        """Walk by a command from the last state, in steps that are made while it goes and answer what disturbs it.

        It does not stop at the end: another call goes on in the middle of the step, and one without speeds stops.

        Args:
            ahead: [m/s].
            sideways: to the left [m/s].
            turn: to the left [rad/s].
            duration: [s].
            strict: refuse what the legs cannot follow; it is clipped otherwise, and the result's summary says so.
            store: at the end of the program.

        Raises:
            InvalidParameter: a robot without a file `walking.yaml`, or numbers that cannot be.
        """
        speeds = {"ahead": ahead, "sideways": sideways, "turn": turn}
        for name, value in speeds.items():
            if finite(value).shape != ():
                raise InvalidParameter(name, value, "a finite number [rad/s]" if name == "turn" else "one [m/s]")
        turn_deg = math.degrees(speeds.pop("turn"))
        move = GoMove(go=checked(Go, **speeds, turn_deg=turn_deg, duration=duration, strict=strict))
        return self._do([move], store=store)[-1]

    def act(self, name: str, *, store: bool = False, **changes: Any) -> SimulationResult:
        """Go through postures from the last state, or stand on three legs.

        The robot first takes the posture in which the act begins, in up to 2.5 s, or at once if it stands so.

        Args:
            name: one of the sequences and stands of the robot's ``gaits.yaml``, such as ``bow``.
            store: at the end of the program.
            changes: its parameters to change, such as ``repeat``, or ``foot`` of ``three_legs``.

        Raises:
            SimrobError: as :meth:`walk`.
        """
        return self._do([ActMove(act=checked(Act, name=name, **changes))], store=store)[-1]

    def attach(self, piece: str, tool: str | None = None, *, pose: PoseLike | None = None, store: bool = False) -> None:
        """Take a piece with a tool of the robot; see :meth:`Workcell.attach`.

        Args:
            piece: which.
            tool: one of :attr:`tools`, such as ``left_hand``, or a link, such as ``trunk``; the first tool unless
                given, on the humanoids the right hand, and the trunk of a quadruped.
            pose: its pose in the hand, to put it there; it keeps its place in the world unless given.
            store: at the end of the program.

        Raises:
            UnknownName: no such piece or tool; proposes the nearest.
            InvalidParameter: a piece that is more than 30 mm away, and no pose.
        """
        place = None if pose is None else pose_from_transform(as_transform(pose))
        self._do([AttachMove(attach=checked(Attach, piece=piece, tool=tool, pose=place))], store=store)

    def release(self, piece: str, parent: str = WORLD, *, fixed: bool = False, store: bool = False) -> None:
        """Let go of a piece, in the world or on another piece; see :meth:`Workcell.release`, also for the errors."""
        self._do([ReleaseMove(release=checked(Release, piece=piece, parent=parent, fixed=fixed))], store=store)
