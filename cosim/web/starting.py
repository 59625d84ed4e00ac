"""Showing a run in the browser of this computer: what the commands do that have a page.

Nothing here loads the server before it is asked to: it is an extra that an installation may lack.
"""

import secrets
import webbrowser
from collections.abc import Callable
from typing import Final, NamedTuple

from cosim.installed import check_libraries
from cosim.web.pages import VIEW
from cosim.web.session import Session

NEEDED: Final = ("starlette>=0.40", "uvicorn>=0.54", "websockets>=13")
"""What the server is made of: the extra ``web`` of pyproject.toml."""


class Showing(NamedTuple):
    """How a page is to be shown."""

    port: int = 0
    """On 127.0.0.1; 0: a free one."""
    in_browser: bool = False
    """Open it there."""
    secret: bool = False
    """Talk only with who has the address that was printed."""


def check_installed() -> None:
    """Raise UserError if what the server is made of is not installed."""
    check_libraries("pages", NEEDED)


def show(session: Session, showing: Showing, told: Callable[[str], None], page: str = VIEW) -> None:
    """Serve *session* with *page* until the user interrupts it; *told* gets the page's address first.

    Raise UserError if the port is taken.
    """
    from cosim.web.server import serve

    def tell(address: str) -> None:
        told(address)
        if showing.in_browser:
            webbrowser.open(address)

    serve(session, page, showing.port, secrets.token_urlsafe(16) if showing.secret else None, tell)
