"""Where things are in the checkout that tests read: its root, the tests' own data, and what lies beside it."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
DATA: Final = ROOT / "tests" / "data"
EXPERIMENTS: Final = ROOT / "experiments"
FLOORS: Final = EXPERIMENTS / "floors"
MAPS: Final = ROOT.parent / "shared" / "maps"
"""Real maps, which are no part of the project: tests that need them are skipped where they are not."""
