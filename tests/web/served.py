"""A server for tests: it really listens, in a thread, at a free port."""

import asyncio
import json
import socket
import threading
import time
from collections.abc import Sequence
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import uvicorn
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from cosim.web.guard import HOST
from cosim.web.server import PATIENCE_S, VIEW, Server, Session, config, listening


class Served:
    """A server in a thread, at a free port."""

    def __init__(
        self,
        session: Session,
        token: str | None = None,
        port: int = 0,
        page: Path = VIEW,
        patience_s: float = PATIENCE_S,
        framed: Sequence[Session] = (),
    ) -> None:
        self.server = Server(session, page, patience_s, framed)
        self.listener = listening(port)
        self.port = self.listener.getsockname()[1]
        self.uvicorn = uvicorn.Server(config(self.server.app(self.port, token)))
        self.thread = threading.Thread(target=lambda: asyncio.run(self.uvicorn.serve([self.listener])), daemon=True)
        self.thread.start()

    @property
    def address(self) -> str:
        """What a browser is to open."""
        return f"http://{HOST}:{self.port}/"

    def connect(self, host: str | None = None, query: str = "", **more: Any) -> ClientConnection:
        """Open a WebSocket, to a server that is called *host* in the request."""
        way = socket.create_connection((HOST, self.port))
        return connect(f"ws://{host or f'{HOST}:{self.port}'}/socket{query}", sock=way, proxy=None, **more)

    def get(self, path: str, **headers: str) -> tuple[HTTPResponse, str]:
        """Ask for *path*; a header of the request is given by its name, Host too."""
        way = HTTPConnection(HOST, self.port, timeout=60)
        way.putrequest("GET", path, skip_host=True)
        for name, value in ({"Host": f"{HOST}:{self.port}"} | headers).items():
            way.putheader(name, value)
        way.endheaders()
        answer = way.getresponse()
        text = answer.read().decode()
        way.close()
        return answer, text

    def stop(self) -> None:
        self.uvicorn.should_exit = True
        self.thread.join(60)
        assert not self.thread.is_alive()
        self.listener.close()

    def wait_for(self, pages: int) -> None:
        end_s = time.monotonic() + 60
        while self.server.open != pages:
            assert time.monotonic() < end_s, f"{self.server.open} pages are open"
            time.sleep(0.01)


def next_of(page: ClientConnection, kind: str) -> Any:
    while True:
        message = json.loads(page.recv(timeout=60))
        if message["say"] == kind:
            return message


def until_closed(page: ClientConnection) -> int | None:
    """Read until the server closes the connection, and return the code that it gives."""
    try:
        while True:
            page.recv(timeout=60)
    except ConnectionClosed as closed:
        return None if closed.rcvd is None else closed.rcvd.code
