"""A page that comes with a protocol: in a browser, an operator speaks there at the consoles of its robots.

cosim brings the floor, the time and the connection to the run. What is said at a console only the page and the robots'
machines know. A protocol names its page in its :class:`~cosim.protocol.ProtocolSpec`; an entry point of the group
``cosim.pages`` makes it a command of cosim, which has the name of the entry point.
"""

from pathlib import Path
from typing import NamedTuple


# a module of its own that imports little: `cosim --help` loads all installed pages to say what they are about
class WebPage(NamedTuple):
    """What cosim must know of a page to show it."""

    about: str
    """What a person does there: a short sentence for ``cosim --help``."""
    help: str
    """What its command does with SCENARIO: a sentence for the command's own help."""
    html: Path
    """The file that a browser opens. All files of its folder are served at ``/page/``, cosim's own at ``/static/``."""
    scenario: str | None = None
    """Name of a scenario file beside an experiment's sweep.yaml, which is run when the experiment is named."""
