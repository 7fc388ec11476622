"""A pendant on a real port of this computer, with a session that a test plays, in this process."""

import asyncio
import http.client
import socket
from contextlib import closing, contextmanager, suppress
from queue import SimpleQueue
from threading import Thread
from urllib.parse import urlsplit

from nicegui.testing.general import nicegui_reset_globals

from simrob_drake.extensions.pendant.pendant import Pendant
from simrob_drake.extensions.pendant.server import Server, bound


class Served:
    """What a test needs to know of a server: where it is, the cookie it has left, the pendant, its thread's loop."""

    def __init__(self, open_session, subject, root_path=None):
        self._open_session, self._subject, self._root_path = open_session, subject, root_path
        self._ready, self.cookie = SimpleQueue(), ""
        self._thread = Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    async def _run(self):
        self.loop = asyncio.get_running_loop()
        self.pendant = Pendant(self._open_session, self._subject)
        listening = bound(0)
        self.port = listening.getsockname()[1]
        self.server = Server(self.pendant, self.port, self._root_path)
        await self.server.run_until_stopped(listening, self._ready.put)
        self.pendant.close()

    def start(self):
        self._thread.start()
        place = urlsplit(self.address())
        self.host, self.path, self.query = f"127.0.0.1:{self.port}", place.path, place.query
        _, headers, _ = self.asked(f"?{self.query}")
        self.cookie = headers["set-cookie"].partition(";")[0]

    def address(self):
        """Return the address that is told next: after the first, one whenever one was used."""
        return self._ready.get(timeout=30)

    def stop(self):
        self.server.should_exit = True
        self._thread.join(timeout=10)
        assert not self._thread.is_alive()

    def do(self, call):
        """Do something in the server's thread, as a session would."""
        done = SimpleQueue()
        self.loop.call_soon_threadsafe(lambda: done.put(call()))
        return done.get(timeout=5)

    def asked(self, path="", *, method="GET", body=None, read=True, **headers):
        """Return the status and headers of an answer, and what came with it; the path is below the pendant's."""
        path = path if path.startswith("/") else self.path + path
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)) as line:
            line.request(method, path, body=body, headers={"Cookie": self.cookie} | headers)
            answer = line.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read() if read else b""

    def said(self, raw):
        """Send bytes as they are, and return what is answered at once."""
        answer = b""
        with (
            socket.create_connection(("127.0.0.1", self.port), timeout=10) as line,
            suppress(TimeoutError),
        ):
            line.sendall(raw)
            while part := line.recv(65536):
                answer += part
                line.settimeout(0.2)
        return answer


@contextmanager
def serving(open_session, subject="humanoid", root_path=None):
    with nicegui_reset_globals():
        served = Served(open_session, subject, root_path)
        served.start()
        try:
            yield served
        finally:
            served.stop()
