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

from simrob_drake.base.errors import InvalidParameter, OutputError, SimrobError
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Strict, validate_section
from simrob_drake.base.yaml_files import parse_json
from simrob_drake.extensions.simulink.stepping.station import StepFailed, SteppedStation
from simrob_drake.stations.config import StationConfig

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


def answer(station: SteppedStation, line: bytes) -> dict[str, Any]:
    """Return what is answered to a line of a client, which may be an error in words."""
    try:
        request = validate_section(Request, parse_json(line.decode(), "request"), "request")
        if request.do == "describe":
            return _described(station)
        if request.do == "reset":
            station.reset(dict(request.parameters))
        else:
            _step(station, request)
        outputs = [station.get(name) for name in station.outputs]
        values = [value if math.isfinite(value) else None for value in outputs]
        return {"time": station.time, "outputs": values, "stopped": station.stopped}
    except (SimrobError, StepFailed, UnicodeDecodeError) as problem:
        return {"error": " ".join(str(problem).split())}


def _described(station: SteppedStation) -> dict[str, Any]:
    return {"station": station.config.name, "duration": station.config.duration} | {
        part: [
            {"name": one.name, "unit": one.unit, "value": station.get(one.name)}
            for one in getattr(station, part).values()
        ]
        for part in ("inputs", "outputs", "parameters")
    }


def _step(station: SteppedStation, request: Request) -> None:
    if request.dt is None:
        raise InvalidParameter(
            message("simulink.request_dt", "request: dt"),
            None,
            message("simulink.a_time", "a time [s]"),
        )
    if request.inputs is not None:
        values = request.inputs if isinstance(request.inputs, list) else [request.inputs]
        if len(values) != len(station.inputs):
            raise InvalidParameter(
                message("simulink.request_inputs", "request: inputs"),
                message("simulink.given_numbers", "{count} numbers", count=len(values)),
                f"{len(station.inputs)}",
            )
        for name, value in zip(station.inputs, values, strict=True):
            station.set(name, value)
    station.advance(station.time + request.dt)


class _Handler(socketserver.StreamRequestHandler):
    """One connection: the token, and then requests until the client goes."""

    timeout = _PATIENCE
    disable_nagle_algorithm = True

    def handle(self) -> None:
        server = cast(StationServer, self.server)
        with suppress(OSError):  # the client went
            if not hmac.compare_digest(
                self.rfile.readline(_LONGEST).strip(), server.token.encode()
            ):
                self._tell(
                    {
                        "error": message(
                            "simulink.no_token", "the first line is not the token of this server"
                        )
                    }
                )
            elif not server.free.acquire(blocking=False):
                self._tell(
                    {
                        "error": message(
                            "simulink.too_many_clients",
                            "{most} clients are connected already; end one of them",
                            most=_MOST,
                        )
                    }
                )
            else:
                try:
                    self.connection.settimeout(None)
                    with server.building:
                        station = SteppedStation(server.config)
                    self._talk(station)
                finally:
                    server.free.release()

    def _talk(self, station: SteppedStation) -> None:
        line = b'{"do": "describe"}\n'
        while line:
            if not line.endswith(b"\n"):
                self._tell(
                    {
                        "error": message(
                            "simulink.line_too_long",
                            "the line is longer than {longest} bytes, or ends without a line feed",
                            longest=_LONGEST,
                        )
                    }
                )
                return
            self._tell(answer(station, line))
            line = self.rfile.readline(_LONGEST)

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
        self,
        config: StationConfig,
        *,
        host: str = LOCAL,
        port: int | None = None,
        token: str | None = None,
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
            raise InvalidParameter(
                TOKEN_VARIABLE,
                message("simulink.of_letters", "of {count} letters", count=len(token)),
                message("simulink.eight_or_more", "of 8 or more"),
            )
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
        raise OutputError(
            message(
                "simulink.cannot_listen",
                "nothing can listen at {host}, port {port}: {problem}",
                host=host,
                port=PORT if port is None else port,
                problem=reason.strerror,
            )
        )
