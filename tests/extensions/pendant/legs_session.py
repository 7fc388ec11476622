"""A session without a run, for the legged page: a robot as it is, a program that keeps what it is given, and notes."""

from concurrent.futures import Future

import numpy as np

from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.run import TaughtRun
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.programs.moves.kinds import KINDS, check_move
from simrob_drake.programs.program import Program
from simrob_drake.programs.stages import SEQUENCE
from simrob_drake.robots.catalog import load_robot

READS = ("torque_limits",)
"""What a page asks for to show it; what a user does is noted."""
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def described(name="humanoid"):
    """Return what a run tells of a robot."""
    model = load_robot(name)
    lows, highs = (np.asarray(limits) / model.user_units for limits in model.axis_limits)
    home = model.axis_vector(model.home_deg, "home_deg")
    axes = [
        {
            "name": axis,
            "aliases": list(entry.aliases),
            "unit": "deg",
            "low": low,
            "high": high,
            "now": now,
        }
        for (axis, entry), low, high, now in zip(
            model.axes.items(), lows.tolist(), highs.tolist(), home.tolist(), strict=True
        )
    ]
    legged = model.feet is not None
    gaits, acts = (list(gaits_of(model, steps=steps)) if legged else [] for steps in (True, False))
    acts = [act for act in acts if act != SEQUENCE]
    robot = {
        "model": name,
        "kind": "legs" if legged else "arm",
        "axes": axes,
        "tools": list(model.tools),
        "gaits": gaits,
        "acts": acts,
        "moves": {key: list(kind.model_fields) for key, kind in KINDS.items()},
    }
    signals = [
        {
            "name": name,
            "unit": "rad",
            "title": name,
            "columns": [f"q.{axis}" for axis in model.axes],
        }
        for name in ("reference", "position")
    ]
    pose = {
        "name": "base_pose",
        "unit": "m",
        "title": "base pose",
        "columns": [f"base.{axis}" for axis in POSE],
    }
    return {
        "mode": "dynamic",
        "robots": {name: robot},
        "pieces": ["box", "ball"],
        "bodies": [],
        "loops": [{"name": "balance", "on": True}, {"name": "guard", "on": False}],
        "signals": [*signals, pose],
    }


def take(session, news):
    """Let a session, or its run, have other attributes."""
    for name, value in news.items():
        setattr(session.run if hasattr(session.run, name) else session, name, value)


def be_all_parts(session):
    """Let a session of tests stand for its parts, too: pages find there what it has itself."""
    session.client = session.book = session.history = session.setup = session.arm = (
        session.exports
    ) = session.earlier = session
    session.hand = Hand()
    session.overruled_by = ""
    session.overruling_loop = lambda: session.overruled_by


class Hand:
    """A hand in the view: `leant` has what ghosts were asked for, `calls` the rest."""

    def __init__(self):
        self.asked, self.leant, self.calls = {}, [], []

    def lean(self, axes):
        self.leant.append(dict(axes))

    def open(self):
        self.calls.append(("open",))

    def put(self, *how, **named):
        self.calls.append(("put", *how, named))

    def turn(self, *how):
        self.calls.append(("turn", *how))


class LegsSession:
    """What the legged page calls of a session; `calls` has the names and arguments."""

    can_undo = can_redo = False

    def __init__(self, name="humanoid", *, moves=(), changes=()):
        be_all_parts(self)
        self.subject = self.robot = name
        self.station = f"{name}_dynamic"
        self.description, self.phase, self.pace, self.run = (
            described(name),
            "idle",
            1.0,
            TaughtRun(),
        )
        self.program = Program.model_validate({"moves": list(moves), "changes": list(changes)})
        self.pending, self.targets, self.message = (), {}, Notice()
        self.run.watch(("reference", "position", "base_pose"))
        self.calls, self._hearers = [], []

    def listen(self, callback):
        self._hearers.append(callback)
        return lambda: self._hearers.remove(callback) if callback in self._hearers else None

    def listen_to_view(self, callback):
        return lambda: None

    def told(self, *topics, **news):
        """Let something change, and the listeners hear of it."""
        take(self, news)
        for topic in topics:
            for hearer in list(self._hearers):
                hearer(topic)

    def suggest_duration(self, targets_deg, start=None):
        """Suggest 2.5 s for large angles, which a test can tell from the default."""
        return 2.5 if max(map(abs, targets_deg.values())) > 90 else 1.0

    def test(self, targets_deg, duration):
        self.calls.append(("test", targets_deg, duration))
        before = self.pending[0]["target_deg"] if self.pending else {}
        self.told(
            "program", pending=({"target_deg": {**before, **targets_deg}, "duration": duration},)
        )
        self.ending = Future()
        return self.ending

    def add(self):
        self.calls.append(("add",))
        self.told(
            "program",
            program=self.program.with_added_moves(*map(check_move, self.pending)),
            pending=(),
        )
        return True

    def edit(self, index, move):
        self.calls.append(("edit", index, move))
        self.told("program", program=self.program.with_replaced_move(index, check_move(move)))
        return True

    def remove(self, index):
        self.told("program", program=self.program.without_move(index))
        return True

    def move_entry(self, index, to):
        entry = self.program.moves[index]
        self.told("program", program=self.program.without_move(index).with_inserted_move(to, entry))
        return True

    def switch_loop(self, name, on):
        self.calls.append(("switch_loop", name, on))
        return self.phase == "idle"

    def remove_change(self, index):
        left = [change for number, change in enumerate(self.program.changes) if number != index]
        self.told("program", program=self.program.model_copy(update={"changes": tuple(left)}))
        return True

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)

        def note(*given, **named):
            if name not in READS:
                self.calls.append((name, *given, *([named] if named else [])))
            done = Future()
            done.set_result(None)
            return done

        return note
