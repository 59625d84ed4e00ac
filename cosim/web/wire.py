"""The connection of one WebSocket: a page that stops reading is given up, with what it has not read.

An orderly close waits until all that was sent before it is read. Who does not read can so keep its place, and the task
that sends to it, for as long as it likes, and the server from its end: there the connection is broken off instead.
"""

from asyncio import TimerHandle
from typing import Any, Final

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

_LAST_WORDS_S: Final = 1.0
"""How long a page may take to read what it was sent when the server ends: less than the server waits for it."""


class Wire(WebSocketsSansIOProtocol):
    """Gives a page that reads nothing as long as one that answers no ping: uvicorn's ``ws_ping_timeout``."""

    def __init__(self, *given: Any, **named: Any) -> None:
        """Take what uvicorn gives."""
        super().__init__(*given, **named)
        self._stalled: TimerHandle | None = None

    def pause_writing(self) -> None:
        """Begin to wait: more has been sent than the page has read."""
        super().pause_writing()
        patience_s = self.config.ws_ping_timeout
        if patience_s is not None:
            self._stalled = self.loop.call_later(patience_s, self.transport.abort)

    def resume_writing(self) -> None:
        """Wait no more: the page has read."""
        super().resume_writing()
        self._calm()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more: the page has gone."""
        super().connection_lost(exc)
        self._calm()

    def keepalive_timeout(self) -> None:
        """Give up a page that has not answered a ping, even if it does not read that either."""
        super().keepalive_timeout()
        if self.transport.get_write_buffer_size():
            self.transport.abort()

    def shutdown(self) -> None:
        """Say that the server ends, to whoever reads it."""
        super().shutdown()
        self.loop.call_later(_LAST_WORDS_S, self.transport.abort)

    def _calm(self) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
