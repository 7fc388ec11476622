"""Optuna's dashboard on the journals of searches, for browsers of this computer; it goes on as they do."""

from collections.abc import Mapping
from socketserver import ThreadingMixIn
from threading import Event, Thread
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from simrob_drake.base.errors import OutputError
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.messages import message
from simrob_drake.extensions.tuning.analysis import add_trials, study_in_optuna
from simrob_drake.extensions.tuning.study_folder import StudyFolder

_HOST, _PORT = "127.0.0.1", 8080
_AGAIN = 2.0  # s until journals are read again


class Dashboard:
    """A server of Optuna's dashboard; what it shows, and what is changed there, lives in memory alone."""

    def __init__(self, places: Mapping[str, StudyFolder], port: int | None = None) -> None:
        """Take a port, 8080 or a free one, for searches by name; raises SimrobError: no tune; OutputError: taken."""
        with importing_extra(message("tuning.the_dashboard", "the dashboard"), "tune"):
            from optuna.storages import InMemoryStorage
            from optuna_dashboard import wsgi
        storage = InMemoryStorage()
        self._shown = [
            (study_in_optuna(name, place.study, place.journal.records, storage=storage), place)
            for name, place in places.items()
        ]
        for one in [port] if port is not None else [_PORT, 0]:
            try:
                self._server = make_server(
                    _HOST, one, wsgi(storage), server_class=_Server, handler_class=_Quiet
                )
                break
            except OSError:
                continue
        else:
            raise OutputError(
                message(
                    "tuning.port_is_taken",
                    "port {port} is taken; choose another one with --port, or leave that out",
                    port=port,
                )
            )
        self.address = f"http://{_HOST}:{self._server.server_port}"

    def serve(self) -> None:
        """Serve until :meth:`close`, or until the user interrupts."""
        self._closed = Event()
        Thread(target=self._follow, daemon=True).start()
        try:
            self._server.serve_forever()
        finally:
            self._closed.set()
            self._server.server_close()

    def close(self) -> None:
        """End :meth:`serve`, from another thread."""
        self._server.shutdown()

    def _follow(self) -> None:
        """Add the trials that come."""
        while not self._closed.wait(_AGAIN):
            for found, place in self._shown:
                add_trials(found, place.study, place.journal.read())


class _Server(ThreadingMixIn, WSGIServer):
    daemon_threads = True


class _Quiet(WSGIRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing of each request."""
