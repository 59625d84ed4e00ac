"""Requests that are answered: those of a browser of this computer, from a page that came from this server.

A page of another web site can make a browser connect to 127.0.0.1: its ``Origin`` shows that. A name that was made to
point here (DNS rebinding) shows in ``Host``. If wanted, a secret in the address keeps out other users of this computer.
"""

import secrets
from typing import Final
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

HOST: Final = "127.0.0.1"
NAMES: Final = (HOST, "localhost")
"""Names of the server that a browser of this computer may use."""
_POLICY: Final = "; ".join(("default-src 'self'", "img-src 'self' data:", "base-uri 'none'", "form-action 'none'"))


class Guard:
    """Passes on requests that may be answered and refuses the others: HTTP with 403, a WebSocket before it is open."""

    def __init__(self, app: ASGIApp, port: int, token: str | None = None, framed: bool = False) -> None:
        """Guard *app* at *port*; with a *token* a WebSocket is opened only for a page that sends it.

        *framed*: pages may be in frames of pages of this server, and of no other; else in none.
        """
        self._app = app
        self._hosts = {f"{name}:{port}" for name in NAMES} | (set(NAMES) if port == 80 else set())
        self._token = token
        # not every browser takes a WebSocket to the page's own server for 'self'
        ancestors = "frame-ancestors 'self'" if framed else "frame-ancestors 'none'"
        sockets = " ".join(sorted(f"ws://{host}" for host in self._hosts))
        self._policy = f"{_POLICY}; {ancestors}; connect-src 'self' {sockets}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, as ASGI has it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        fault = self._fault(scope)
        if fault is None:
            await self._app(scope, receive, send if scope["type"] == "websocket" else _with_headers(send, self._policy))
        elif scope["type"] == "websocket":
            await WebSocketClose(code=1008, reason=fault)(scope, receive, send)
        else:
            await PlainTextResponse(f"{fault}\n", status_code=403)(scope, receive, send)

    def _fault(self, scope: Scope) -> str | None:
        """Return why a request is refused; None if it is answered."""
        headers = Headers(scope=scope)
        host, origins = headers.getlist("host"), headers.getlist("origin")
        if len(host) != 1 or host[0].lower() not in self._hosts:
            return "this server does not go by that name"
        if any(origin.lower() != f"http://{host[0].lower()}" for origin in origins):
            return "this server does not answer pages from elsewhere"
        if self._token is not None and scope["type"] == "websocket":
            given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
            if not secrets.compare_digest(given.encode(), self._token.encode()):
                return "the address lacks the secret that the server has printed"
        return None


def _with_headers(send: Send, policy: str) -> Send:
    """Return *send* with headers that restrict a page to what comes from this server, and let nothing be cached."""

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = policy
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Referrer-Policy"] = "no-referrer"
            headers["Cache-Control"] = "no-cache"
        await send(message)

    return sent
