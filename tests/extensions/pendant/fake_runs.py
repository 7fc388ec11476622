"""Runs for sessions under test: one that only counts time, and the real one without a process around it."""

from concurrent.futures import Future

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.remarks import Remark
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.extensions.pendant.bench import ALONE, Bench
from simrob_drake.extensions.pendant.run_pacer import RunLost

TICK = 0.05


class CountingRun:
    """Takes what a session asks a run for: moves take their time, and nothing is simulated.

    ``calls`` has all that was asked for; with ``held`` a run goes on until :meth:`finish`.
    """

    held = False
    shown = True  # whether it goes on from what was asked to be shown
    positions = None
    refused = ""
    dead = False

    def __init__(self, on_news):
        self.tell, self.calls, self.time, self.closed = on_news, [], 0.0, False
        self.running, self.begun, self.end, self.back = None, 0.0, 0.0, False

    def call(self, method, /, **arguments):
        self.calls.append(
            (method, {name: value for name, value in arguments.items() if name != "positions"})
        )
        future = Future()
        if method in ALONE:  # which ends what runs
            self._stop()
        try:
            if self.dead:
                raise RunLost
            if self.refused == method:
                raise SimrobError(f"{method} cannot be")
            result = getattr(self, f"_{method}", lambda **_: None)(**arguments)
        except SimrobError as problem:
            future.set_exception(problem)
            return future
        if result == "running" and self.held:
            self.running = future
        else:
            future.set_result(result)
        return future

    def asked(self, *methods):
        """Return what was asked for of some methods, in order."""
        return [(method, arguments) for method, arguments in self.calls if method in methods]

    def finish(self, ending="completed", *, goes_on=True, time=None, reached=None):
        """End the run."""
        if not self.back:  # else it stands where it was gone back to
            self.time = self.end if time is None else time
        remark = Remark("success" if ending == "completed" else "failure", ending)
        how = {
            "ending": ending,
            "goes_on": goes_on,
            "message": ending,
            "remarks": [remark],
            "criteria": [],
        }
        where = {
            "begun": self.begun,
            "time": self.time,
            "reached": self.time if reached is None else reached,
        }
        self.tell({"news": "ended", **how, **where, "moves": [], "signals": {}})
        self.tell({"news": "phase", "phase": "idle"})
        if self.running is not None:
            self.running.set_result({"ending": ending})
            self.running = None

    def tick(self, time, **values):
        """Tell of a moment of the run."""
        self.time = time
        self.tell(
            {"news": "tick", "time": time, "ratio": 1.0, "positions": [time], "values": values}
        )

    def note(self, **change):
        """Tell of a change."""
        self.tell({"news": "noted", "change": {"time": self.time, **change}})

    def die(self):
        """Be killed."""
        running, self.running, self.dead = self.running, None, True
        if running is not None:
            running.set_exception(RunLost())
        self.tell({"news": "died", "why": "killed by signal 9"})

    def close(self):
        self.closed = True

    def _open(self, station, settings, robot, allow_code):
        self.time = 0.0
        return {
            "station": station,
            "robots": {robot: {"tcp": "flange", "kind": "legs"}},
            "bodies": [],
            "loops": [],
        }

    def _do(self, moves):
        return self._begin(sum(move.get("duration", 1.0) for move in moves))

    def _jog(self, targets_deg, duration):
        return self._begin(duration or 1.0)

    def _play(self, program):
        self.time = 0.0
        return self._do(parse_yaml(program, "the program")["moves"])

    def _stop(self):
        if self.running is not None:
            self.finish("stopped", time=self.time)

    def _rewind(self, time, positions):
        self.positions = positions
        ran = self.shown and time <= self.end  # else it is of a run that was lost
        if ran:
            self.time, self.back = time, True
        return ran

    def _go_on(self):
        if self.running is None and self.back and self.time < self.end:
            return self._begin(self.end - self.time)
        self.back = False
        return None

    def _restart(self):
        self.time, self.back = 0.0, False

    def _begin(self, time):
        self.begun, self.end, self.back = self.time, self.time + time, False
        self.tell({"news": "phase", "phase": "running"})
        if not self.held:
            self.finish()
        return "running"


class BenchRun:
    """The real run, in this process; ``at`` has what is asked for at ticks, ``{time: [(method, arguments)]}``."""

    def __init__(self, on_news):
        self._tell, self.at = on_news, {}
        self._bench = Bench(self, self._serve)
        self._bench.pacer.set_pace(None)

    def call(self, method, /, **arguments):
        future = Future()
        try:
            future.set_result(None if method == "pace" else self._bench.find(method)(**arguments))
        except SimrobError as problem:
            future.set_exception(problem)
        return future

    def close(self):
        pass

    def _serve(self, bench):
        number = bench.pacer.line.steps(bench.pacer.now)
        for method, arguments in self.at.pop(round(number * TICK, 12), ()):
            bench.find(method)(**arguments)

    # As an Inbox

    def tell(self, news, **more):
        self._tell({"news": news, **more})

    def wait(self, timeout):
        raise AssertionError("nothing is waited for")
