"""A run under way that begins anew when it has ended and a page asks for that: the same scenario and seed."""

from collections.abc import Callable

from cosim.errors import UserError
from cosim.web.history import Cursor
from cosim.web.live import Live
from cosim.web.messages import Again, AskPresent, Plain, Wish
from cosim.web.timeline import Timeline

_OVER = ("ended", "failed")


class Anew:
    """A session of one run after the other. Pages are told of a new one, and connect again to see it."""

    def __init__(self, make: Callable[[], Live]) -> None:
        """Begin the first run; *make* begins one."""
        self._make = make
        self._run = make()
        self._count = 0

    @property
    def scene(self) -> Plain:
        """What does not change during a run, and that it can begin anew."""
        return self._run.scene | {"again": True}

    @property
    def timeline(self) -> Timeline:
        """The boxes of the present run."""
        return self._run.timeline

    def wish(self, wish: Wish) -> None:
        """Do what a page asks for; raise UserError, one line, if it cannot be done."""
        if not isinstance(wish, Again):
            self._run.wish(wish)
            return
        if self._run.state not in _OVER:
            raise UserError("this run has not ended")
        self._run.close()
        self._run = self._make()
        self._count += 1

    def look(self, cursor: Cursor | None) -> tuple[list[Plain], Cursor]:
        """Return the messages for a page that has been sent all up to *cursor*, and the new cursor."""
        if cursor is not None and cursor.run != self._count:
            return [{"say": "again"}], cursor  # it connects again: nothing else is for it
        told, new = self._run.look(cursor)
        return told, new._replace(run=self._count)

    def answer(self, asked: AskPresent) -> Plain:
        """Return the answer to what a page asks about the present."""
        return self._run.answer(asked)

    def close(self) -> None:
        """End the present run."""
        self._run.close()
