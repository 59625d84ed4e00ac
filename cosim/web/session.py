"""What a server needs of a run that it shows, be it recorded or under way."""

from typing import Protocol

from cosim.web.history import Cursor
from cosim.web.messages import Plain, Wish


class Session(Protocol):
    """A run that pages look at. All of them see the same, and what one asks for happens for all."""

    @property
    def scene(self) -> Plain:
        """What does not change, and goes to each page first."""

    def wish(self, wish: Wish) -> None:
        """Take what a page asks for; raise UserError, one line, if it cannot be."""

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return what a page is to be told that has been told up to *cursor* (None: nothing), and the new cursor."""

    def close(self) -> None:
        """End it, and wait until nothing of it runs any more; more than once is harmless."""
