"""A station stepped over TCP: one line of JSON each way. docs/simulink.md tells the protocol.

Each connection has a station of its own, and begins with the token; nothing but inputs and parameters can be set.
"""

import hmac
import json
import math
import secrets
import socketserver
from contextlib import suppress
from pathlib import Path
from threading import BoundedSemaphore, Lock
from typing import Annotated, Any, Literal, cast

from pydantic import Field

from simrob_drake.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.sections import Number, Strict, validated
from simrob_drake.simulink.stepping.station import StepFailed, SteppedStation
from simrob_drake.stations.config import StationConfig
from simrob_drake.yaml_files import parse_json

LOCAL, PORT = "127.0.0.1", 8300
CLIENT = Path(__file__).parent / "client"  # the folder with functions for MATLAB and Octave
TOKEN_VARIABLE = "SIMROB_TOKEN"
_PATIENCE = 10.0  # s, for the token
_LONGEST = 1_000_000  # bytes of a line
_MOST = 8  # connections


class Request(Strict):
    """What a client asks."""

    do: Literal["describe", "reset", "step"]
    """Tell the ports and parameters; begin anew; or go on."""
    parameters: list[tuple[str, Number]] = Field(default_factory=list)
    """Those to begin with, by name."""
    inputs: list[Number] | Number | None = None
    """All inputs in their order, or the only one; as they are unless given."""
    dt: Annotated[Number, Field(gt=0, le=3600)] | None = None
    """How far to go [s]."""


class ServedStation:
    """The station of one client."""

    def __init__(self, config: StationConfig) -> None:
        self._station = SteppedStation(config)

    def answer(self, line: bytes) -> dict[str, Any]:
        """Return what is answered to a line, which may be an error in words."""
        try:
            request = validated(Request, parse_json(line.decode(), "request"), "request")
            return getattr(self, f"_{request.do}")(request)  # type: ignore[no-any-return]  # a name of a Literal
        except (SimrobError, StepFailed, UnicodeDecodeError) as problem:
            return {"error": " ".join(str(problem).split())}

    def _describe(self, _: Request) -> dict[str, Any]:
        station = self._station

        def listed(entries: Any) -> list[dict[str, Any]]:
            return [{"name": one.name, "unit": one.unit, "value": station.get(one.name)} for one in entries.values()]

        return {
            "station": station.config.name,
            "duration": station.config.duration,
            "inputs": listed(station.inputs),
            "outputs": listed(station.outputs),
            "parameters": listed(station.parameters),
        }

    def _reset(self, request: Request) -> dict[str, Any]:
        self._station.reset(dict(request.parameters))
        return self._outputs()

    def _step(self, request: Request) -> dict[str, Any]:
        if request.dt is None:
            raise InvalidParameter("request: dt", None, "a time [s]")
        if request.inputs is not None:
            values = request.inputs if isinstance(request.inputs, list) else [request.inputs]
            if len(values) != len(self._station.inputs):
                raise InvalidParameter("request: inputs", f"{len(values)} numbers", f"{len(self._station.inputs)}")
            for name, value in zip(self._station.inputs, values, strict=True):
                self._station.set(name, value)
        self._station.advance(self._station.time + request.dt)
        return self._outputs()

    def _outputs(self) -> dict[str, Any]:
        outputs = [self._station.get(name) for name in self._station.outputs]
        values = [value if math.isfinite(value) else None for value in outputs]
        return {"time": self._station.time, "outputs": values, "stopped": self._station.stopped}


class _Handler(socketserver.StreamRequestHandler):
    """One connection: the token, and then requests until the client goes."""

    timeout = _PATIENCE
    disable_nagle_algorithm = True

    def handle(self) -> None:
        server = cast(StationServer, self.server)
        with suppress(OSError):  # the client went
            if not hmac.compare_digest(self.rfile.readline(_LONGEST).strip(), server.token.encode()):
                self._tell({"error": "the first line is not the token of this server"})
            elif not server.free.acquire(blocking=False):
                self._tell({"error": f"{_MOST} clients are connected already; end one of them"})
            else:
                try:
                    self.connection.settimeout(None)
                    with server.building:
                        session = ServedStation(server.config)
                    self._talk(session)
                finally:
                    server.free.release()

    def _talk(self, session: ServedStation) -> None:
        self._tell(session.answer(b'{"do": "describe"}'))
        while line := self.rfile.readline(_LONGEST):
            if not line.endswith(b"\n"):
                self._tell({"error": f"the line is longer than {_LONGEST} bytes, or ends without a line feed"})
                return
            self._tell(session.answer(line))

    def _tell(self, answer: dict[str, Any]) -> None:
        self.wfile.write(json.dumps(answer, ensure_ascii=False).encode() + b"\n")


class StationServer(socketserver.ThreadingTCPServer):
    """Serves a station to whoever knows the token.

    Attributes:
        config: the station, which each client has anew.
        token: the first line of a client.
    """

    allow_reuse_address = daemon_threads = True

    def __init__(
        self, config: StationConfig, *, host: str = LOCAL, port: int | None = None, token: str | None = None
    ) -> None:
        """Listen; ``serve_forever`` then answers.

        Args:
            config: the station.
            host: the address at which to listen.
            port: the one at which to listen; 8300, or a free one where that is taken, unless given.
            token: a secret of at least 8 letters; a random one unless given.

        Raises:
            InvalidParameter: a kinematic station, or a token that is short.
            SimrobError: a station that cannot be built.
            OutputError: host or port cannot be had.
        """
        if token is not None and len(token) < 8:
            raise InvalidParameter(TOKEN_VARIABLE, f"of {len(token)} letters", "of 8 or more")
        SteppedStation(config)  # what is wrong with it is told here, and not to the first client
        self.config, self.token = config, token or secrets.token_urlsafe(16)
        self.free, self.building = BoundedSemaphore(_MOST), Lock()
        for one in (PORT, 0) if port is None else (port,):
            try:
                super().__init__((host, one), _Handler)
            except OSError as problem:
                reason = problem
                continue
            return
        raise OutputError(f"nothing can listen at {host}, port {PORT if port is None else port}: {reason.strerror}")
