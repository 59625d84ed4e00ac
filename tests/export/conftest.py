from pathlib import Path

import pandas as pd
import pytest

from cosim.export.recording import Recording
from tests.export.recordings import BLUETOOTH, QUIET, WALLS, make, relayed


@pytest.fixture(scope="session")
def short() -> Recording:
    """Return the recording of a second of 802.11."""
    return make(QUIET)[0]


@pytest.fixture(scope="session")
def line() -> tuple[Recording, dict[str, pd.DataFrame]]:
    """Return a recording of 802.11 whose robots reserve the medium and look for routes, and its tables."""
    return relayed()


@pytest.fixture(scope="session")
def piconet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, dict[str, pd.DataFrame], Path]:
    """Return a recording of a piconet that loses frames, its tables, and the folder with its trace."""
    folder = tmp_path_factory.mktemp("piconet")
    return *make(BLUETOOTH, folder), folder


@pytest.fixture(scope="session")
def walls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, dict[str, pd.DataFrame], Path]:
    """Return a recording of 802.11 with faults, its tables, and the folder with its trace."""
    folder = tmp_path_factory.mktemp("walls")
    return *make(WALLS, folder), folder
