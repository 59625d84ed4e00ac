"""The page on which a person calls plays: the files in ``static``, which speak the language of the console."""

from pathlib import Path
from typing import Final

from cosim.page import WebPage

PAGE: Final = WebPage(
    about="Call plays of a run from a page.",
    help="Run SCENARIO, a YAML file or an experiment's name, with a page on which a person calls plays.",
    html=Path(__file__).parent / "static" / "playbook.html",
    scenario="playbook.yaml",
)
"""The page that the command ``cosim playbook`` shows."""
