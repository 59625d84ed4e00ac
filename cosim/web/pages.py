"""The pages that a server shows: files beside this one, plain modules for the browser, nothing from elsewhere."""

from pathlib import Path
from typing import Final

STATIC: Final = Path(__file__).parent / "static"
"""The folder of all that a browser loads."""
VIEW: Final = "view.html"
"""The page that shows a run."""


def page_path(name: str) -> Path:
    """Return the file of the page *name*; raise FileNotFoundError if the installation lacks it."""
    path = STATIC / name
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing: the installation of cosim is not complete")
    return path
