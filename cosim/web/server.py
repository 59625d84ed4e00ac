"""The server of one session: its page, what that loads, and a WebSocket over which they talk.

Each page has a task that sends, one that receives, and one that has answers about the present computed, in threads: the
page is heard meanwhile. A message is composed when the page can take it, from what there is then: a slow page gets the
newest state and no backlog, and nothing waits for it. So what the server keeps for a page that reads nothing is one
message, and a few answers, and after ``PATIENCE_S`` that page is given up. Why a connection has ended is logged (at the
level INFO, by the name of this module); a page that finds it ended connects again.
"""

import asyncio
import logging
import socket
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, closing, suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import Final, Generic, Protocol, TypeVar

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
from cosim.web.messages import LONGEST, AskMap, AskPresent, AskReach, AskScan, Plain, Wish, error, parsed, written
from cosim.web.reach import reach
from cosim.web.timeline import Known, Question, Timeline

STATIC: Final = Path(__file__).parent / "static"
"""Folder of the modules that all pages share, and of the page ``VIEW``; served at ``/static/``."""
VIEW: Final = STATIC / "view.html"
"""Page that shows a run."""
PAIR: Final = STATIC / "pair.html"
"""Page that has the pages of two runs in frames."""
MOST_PAGES: Final = 32
"""Maximum number of open WebSockets."""
PATIENCE_S: Final = 20.0
"""Time after which a page that reads nothing, or answers no ping, is given up."""
_PERIOD_S: Final = 0.04
"""Interval between two messages to a page: what a screen can show."""
_ERRORS: Final = 16
"""Maximum number of error messages that wait for a page."""
_ANSWERS: Final = 16
"""Maximum number of answers about the present that wait for a page."""
_QUESTIONS: Final = 32
"""Maximum number of questions of a page about the timeline that wait, and of those about the present."""
_TRY_AGAIN: Final = 1013
"""Code of a WebSocket that is closed since the server is busy (RFC 6455, as registered with IANA),"""
_FAILED: Final = 1011
"""and of one that is closed since the server has failed."""
_LONGEST_REASON: Final = 123
"""Maximum length of the reason for which a WebSocket is closed, B (RFC 6455, section 5.5)."""
_LOG: Final = logging.getLogger(__name__)
T = TypeVar("T")


class Session(Protocol):
    """A run that pages look at, recorded or under way. All of them see the same: what one asks for happens for all."""

    @property
    def scene(self) -> Plain:
        """What does not change, and is sent to each page first."""

    def wish(self, wish: Wish) -> None:
        """Do what a page asks for; raise UserError, one line, if it cannot be done."""

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return the messages for a page that has been sent all up to *cursor* (None: nothing), and the new cursor."""

    def answer(self, asked: AskPresent) -> Plain:
        """Return the answer to what a page asks about the present; raise UserError, one line, if there is none."""

    @property
    def timeline(self) -> Timeline:
        """Its boxes, on the axis of time."""

    def close(self) -> None:
        """End it, and wait until nothing of it runs any more; more than once is harmless."""


class Server:
    """What the pages of one session connect to."""

    def __init__(
        self, session: Session, page: Path = VIEW, patience_s: float = PATIENCE_S, framed: Sequence[Session] = ()
    ) -> None:
        """Serve *session* with *page*, an HTML file; what else lies in its folder is served at ``/page/``.

        The sessions *framed* are served with ``VIEW`` at ``/runs/0/``, ``/runs/1/``, ..., which the page has in frames.
        Raise FileNotFoundError if the installation lacks the page.
        """
        if not page.is_file():
            raise FileNotFoundError(f"{page} is missing: the installation of cosim is not complete")
        self.session = session
        self.framed = framed
        self.open = 0
        """Number of pages that are connected."""
        self._page = page
        self._patience_s = patience_s
        self._numbers = count()

    def app(self, port: int, token: str | None = None) -> ASGIApp:
        """Return the application, as it answers at *port*."""
        routes = [
            Route("/", self._index),
            WebSocketRoute("/socket", self._talk_of_all),
            Mount("/static", StaticFiles(directory=STATIC)),
            Mount("/page", StaticFiles(directory=self._page.parent)),
        ]
        for number, session in enumerate(self.framed):
            routes.append(Route(f"/runs/{number}/", self._run))
            routes.append(WebSocketRoute(f"/runs/{number}/socket", partial(self._talk, session)))
        return Guard(Starlette(routes=routes, lifespan=self._lifespan), port, token, framed=bool(self.framed))

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            for session in (self.session, *self.framed):
                await asyncio.to_thread(session.close)

    async def _index(self, _: Request) -> FileResponse:
        return FileResponse(self._page)

    async def _run(self, _: Request) -> FileResponse:
        return FileResponse(VIEW)

    async def _talk_of_all(self, page: WebSocket) -> None:
        await self._talk(self.session, page)

    async def _talk(self, session: Session, page: WebSocket) -> None:
        """Exchange messages with one page until either side ends that."""
        await page.accept()  # first: no browser tells its page why it was not
        if self.open >= MOST_PAGES:
            await page.close(_TRY_AGAIN, "too many pages are open")
            return
        self.open += 1
        number = next(self._numbers)
        waiting = Waiting()
        send, receive = self._send(session, page, waiting, number), self._receive(session, page, waiting)
        tasks = [asyncio.create_task(each) for each in (send, receive, self._compute(session, waiting))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.open -= 1
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for fault in [task.exception() for task in done]:
            if isinstance(fault, _EndedError):
                _LOG.info("page %d: %s", number, str(fault))  # a record that has the fault keeps its frames
            elif fault is not None:
                await self._fail(page, fault)
                raise fault

    async def _fail(self, page: WebSocket, fault: BaseException) -> None:
        """Close the connection of *page*, and tell it why."""
        why = f"{type(fault).__name__}: {fault}".encode()[:_LONGEST_REASON].decode(errors="ignore")
        with suppress(RuntimeError, OSError, WebSocketDisconnect):  # it is closed already, or reads nothing
            async with asyncio.timeout(self._patience_s):
                await page.close(_FAILED, why)

    async def _send(self, session: Session, page: WebSocket, waiting: "Waiting", number: int) -> None:
        """Send the scene, then what is new, as often as a screen can show it and the page can take it."""
        await self._deliver(page, {"say": "scene"} | session.scene | {"page": number})
        cursor: Cursor | None = None
        known: Known | None = None
        while True:
            faults = [waiting.faults.popleft() for _ in range(len(waiting.faults))]
            answers = [waiting.answers.get_nowait() for _ in range(waiting.answers.qsize())]
            lanes, known = session.timeline.told(known)
            told, cursor = session.look(cursor)
            for message in (*faults, *answers, *([] if lanes is None else [lanes]), *told):
                await self._deliver(page, message)
            await self._answer(session, page, waiting)

    async def _answer(self, session: Session, page: WebSocket, waiting: "Waiting") -> None:
        """Answer questions about the timeline as they come, for as long as a screen shows a picture."""
        ends_s = asyncio.get_running_loop().time() + _PERIOD_S
        while (left_s := ends_s - asyncio.get_running_loop().time()) > 0:
            try:
                question = await asyncio.wait_for(waiting.timeline.next(), left_s)
            except TimeoutError:
                return
            try:
                answer = session.timeline.answer(question)
            except UserError as fault:
                answer = error(str(fault))
            await self._deliver(page, answer)

    async def _deliver(self, page: WebSocket, message: Plain | bytes) -> None:
        """Send *message*, after what the page has still to read; raise _EndedError if it reads nothing for long."""
        text = "" if isinstance(message, bytes) else written(message)
        try:
            async with asyncio.timeout(self._patience_s):
                await (page.send_bytes(message) if isinstance(message, bytes) else page.send_text(text))
        except TimeoutError:
            raise _EndedError(f"it has read nothing for {self._patience_s:g} s") from None
        except (RuntimeError, WebSocketDisconnect) as fault:  # the former if the server has closed it by itself
            raise _EndedError(f"it can be sent nothing any more: {fault!r}") from None

    async def _receive(self, session: Session, page: WebSocket, waiting: "Waiting") -> None:
        """Do what the page asks for; answer what is malformed, or cannot be done, by an error. Raise _EndedError."""
        while True:
            message = await page.receive()
            if message["type"] == "websocket.disconnect":
                raise _EndedError(
                    f"it is closed, code {message['code']}: {message.get('reason') or 'no reason is given'}"
                )
            given = message.get("text")
            wish = None
            try:
                asked = parsed(message.get("bytes") or b"" if given is None else given)
                if isinstance(asked, AskReach | AskMap | AskScan):
                    if asked not in waiting.present:  # a page asks again until it knows: one answer tells it
                        waiting.present.ask(asked)
                elif isinstance(asked, Question):
                    waiting.timeline.ask(asked)
                else:
                    wish = asked
                    session.wish(wish)
            except UserError as fault:
                waiting.faults.append(error(str(fault), wish))

    async def _compute(self, session: Session, waiting: "Waiting") -> None:
        """Have questions about the present answered, one after the other: each takes its time, in a thread."""
        while True:
            asked = await waiting.present.next()
            try:
                if isinstance(asked, AskReach):
                    answer = await asyncio.to_thread(reach, session.scene, asked.robot, (asked.x_m, asked.y_m))
                else:
                    answer = await asyncio.to_thread(session.answer, asked)
            except UserError as fault:
                answer = error(str(fault))
            await waiting.answers.put(answer)


class _EndedError(Exception):
    """The connection of a page has ended, or is to, for a reason that lies in the page or in between."""


class Questions(Generic[T]):
    """Questions that wait for their answers, in the order in which they were asked."""

    def __init__(self) -> None:
        self._waiting: deque[T] = deque()
        self._asked = asyncio.Event()

    def __contains__(self, question: T) -> bool:
        return question in self._waiting

    def ask(self, question: T) -> None:
        """Have *question* answered; raise UserError if too many wait."""
        if len(self._waiting) >= _QUESTIONS:
            raise UserError("too many questions wait: ask when the last ones have been answered")
        self._waiting.append(question)
        self._asked.set()

    async def next(self) -> T:
        """Return the question that is to be answered next, as soon as there is one."""
        await self._asked.wait()
        question = self._waiting.popleft()
        if not self._waiting:
            self._asked.clear()
        return question


class Waiting:
    """What waits to be sent to a page, or to be answered."""

    def __init__(self) -> None:
        self.faults: deque[Plain] = deque(maxlen=_ERRORS)
        self.timeline: Questions[Question] = Questions()
        self.present: Questions[AskReach | AskPresent] = Questions()
        self.answers: asyncio.Queue[Plain] = asyncio.Queue(_ANSWERS)
        """Answers about the present: while they are not taken, nothing more is computed."""


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
    page: Path = VIEW,
    port: int = 0,
    token: str | None = None,
    told: Callable[[str], None] = print,
    framed: Sequence[Session] = (),
) -> None:
    """Show *session* with *page*, and *framed* in frames of it, until the process is interrupted, then close all.

    *told* gets the address first. Raise UserError if the port is taken.
    """
    with closing(session), listening(port) as listener:
        number = listener.getsockname()[1]
        server = uvicorn.Server(config(Server(session, page, framed=framed).app(number, token)))
        told(f"http://{HOST}:{number}/" + (f"?token={token}" if token else ""))
        with suppress(KeyboardInterrupt):  # the way to end it
            server.run(sockets=[listener])


def config(app: ASGIApp) -> uvicorn.Config:
    """Return how *app* is served: quietly, with bounded messages, and soon gone when it is to end."""
    return uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        lifespan="on",
        ws_max_size=LONGEST,
        ws_ping_interval=PATIENCE_S,
        ws_ping_timeout=PATIENCE_S,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,  # it waits for what pages have not read, and complains
        server_header=False,
        proxy_headers=False,
    )
