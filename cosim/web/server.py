"""The server of one session: its page, what that loads, and a WebSocket over which they talk.

Each page has a task that sends and one that listens. What is sent is composed when the page can take it, from what
there is then: a slow page gets the newest state and no backlog, and nothing waits for it.
"""

import asyncio
import socket
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing, suppress
from itertools import count
from typing import Final

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from cosim.errors import UserError
from cosim.web.guard import HOST, Guard
from cosim.web.history import Cursor
from cosim.web.messages import LONGEST, Plain, error, parsed, written
from cosim.web.pages import STATIC, VIEW, page_path
from cosim.web.session import Session
from cosim.web.wire import Wire

MOST_PAGES: Final = 32
"""WebSockets that may be open at once."""
_PERIOD_S: Final = 0.04
"""Between two messages to a page: what a screen can show."""
_ERRORS: Final = 16
"""Answers to malformed messages that may wait for a page."""
_TRY_AGAIN: Final = 1013


class Server:
    """What the pages of one session connect to."""

    def __init__(self, session: Session, page: str = VIEW) -> None:
        """Serve *session* with *page*, a file of :mod:`cosim.web.pages`."""
        self.session = session
        self.open = 0
        """How many pages are connected."""
        self._page = page_path(page)
        self._numbers = count()

    def app(self, port: int, token: str | None = None) -> ASGIApp:
        """Return the application, as it answers at *port*."""
        routes = [
            Route("/", self._index),
            WebSocketRoute("/socket", self._talk),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        return Guard(Starlette(routes=routes, lifespan=self._lifespan), port, token)

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            await asyncio.to_thread(self.session.close)

    async def _index(self, _: Request) -> FileResponse:
        return FileResponse(self._page)

    async def _talk(self, page: WebSocket) -> None:
        """Talk with one page until either side has enough."""
        await page.accept()  # first: no browser tells its page why it was not
        if self.open >= MOST_PAGES:
            await page.close(_TRY_AGAIN, "too many pages are open")
            return
        self.open += 1
        faults: deque[Plain] = deque(maxlen=_ERRORS)
        tasks = {asyncio.create_task(self._tell(page, faults)), asyncio.create_task(self._listen(page, faults))}
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.open -= 1
            for task in tasks:
                task.cancel()
            ended = await asyncio.gather(*tasks, return_exceptions=True)
        for fault in ended:
            if isinstance(fault, Exception) and not isinstance(fault, WebSocketDisconnect | RuntimeError | OSError):
                raise fault

    async def _tell(self, page: WebSocket, faults: deque[Plain]) -> None:
        """Send the scene, then what is new, as often as a screen can show it and the page can take it."""
        await page.send_text(written({"say": "scene"} | self.session.scene | {"page": next(self._numbers)}))
        cursor: Cursor | None = None
        while True:
            messages = [faults.popleft() for _ in range(len(faults))]
            told, cursor = self.session.look(cursor)
            for message in (*messages, *told):
                await page.send_text(written(message))
            await asyncio.sleep(_PERIOD_S)

    async def _listen(self, page: WebSocket, faults: deque[Plain]) -> None:
        """Pass on what the page asks for; what is malformed, or cannot be, is answered by an error."""
        while True:
            message = await page.receive()
            if message["type"] == "websocket.disconnect":
                return
            given = message.get("text")
            wish = None
            try:
                wish = parsed(message.get("bytes") or b"" if given is None else given)
                self.session.wish(wish)
            except UserError as fault:
                faults.append(error(str(fault), wish))


def listening(port: int) -> socket.socket:
    """Return a socket that listens on 127.0.0.1 at *port* (0: a free one); raise UserError if that is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen(64)
    except OSError as fault:
        listener.close()
        raise UserError(f"--port {port}: {fault.strerror or fault}") from None
    return listener


def serve(
    session: Session,
    page: str = VIEW,
    port: int = 0,
    token: str | None = None,
    told: Callable[[str], None] = print,
) -> None:
    """Show *session* until the process is interrupted, then close it; *told* gets the page's address first.

    Raise UserError if the port is taken.
    """
    with closing(session), listening(port) as listener:
        number = listener.getsockname()[1]
        server = uvicorn.Server(config(Server(session, page).app(number, token)))
        told(f"http://{HOST}:{number}/" + (f"?token={token}" if token else ""))
        with suppress(KeyboardInterrupt):  # the way to end it
            server.run(sockets=[listener])


def config(app: ASGIApp, patience_s: float = 20.0) -> uvicorn.Config:
    """Return how *app* is served: quietly, with bounded messages, and soon gone when it is to end.

    *patience_s*: how long a page may read nothing, or not answer a ping.
    """
    return uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        lifespan="on",
        ws=Wire,
        ws_max_size=LONGEST,
        ws_ping_interval=20,
        ws_ping_timeout=patience_s,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
        server_header=False,
        proxy_headers=False,
    )
