"""Faults planted in the Bluetooth channel are found by its comparison with the oracle, one in every place that matters."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import pytest

from cosim.errors import LocalProtocolError
from tests import test_oracle_band, test_oracle_inquiry, test_oracle_page, test_oracle_polling
from tests.band_channel import Outcome, run_channel
from tests.oracles.band_cases import Case
from tests.oracles.campaign import plant


class Compared(NamedTuple):
    """A case, what the oracle says of it, and whether it says so of idle frames too."""

    case: Case
    slow: Outcome
    idle: bool = True


def band() -> Iterator[Compared]:
    return (Compared(*pair) for pair in test_oracle_band.default_cases())


def inquiry() -> Iterator[Compared]:
    return (Compared(*pair) for pair in test_oracle_inquiry.default_cases())


def page() -> Iterator[Compared]:
    return (Compared(*pair) for pair in test_oracle_page.default_cases())


def polling() -> Iterator[Compared]:
    return (Compared(*polling, slow)[::2] for polling, slow in ())


FAULTS = []
