"""Faults planted in the Bluetooth channel, one wherever it might go wrong: its comparison with the oracle finds them.

Each is one replacement in the source of one module; the cases are those of the default runs of the comparisons. Every
fourth is planted in the slow tier, the others in the soak.
"""

import pytest

from cosim.errors import LocalProtocolError
from tests.channels.bluetooth import test_oracle_band, test_oracle_inquiry, test_oracle_page, test_oracle_polling
from tests.channels.bluetooth.band_channel import run_channel
from tests.oracles.campaign import plant
from tests.oracles.faults_band import BAND_FAULTS, Fault
from tests.oracles.faults_intervals import INTERVAL_FAULTS
from tests.oracles.faults_rooms import ROOM_FAULTS
from tests.tiers import soak_count

COMPARISONS = {
    "band": test_oracle_band,
    "inquiry": test_oracle_inquiry,
    "page": test_oracle_page,
    "polling": test_oracle_polling,
}


FAULTS = [*BAND_FAULTS, *ROOM_FAULTS, *INTERVAL_FAULTS]
OFTEN = FAULTS[::4]
SELDOM = [fault for fault in FAULTS if fault not in OFTEN]
TIERS = [*((fault, pytest.mark.slow) for fault in OFTEN), *((fault, pytest.mark.soak) for fault in SELDOM)]


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, marks=tier, id=f"{fault.comparison}: {fault.name}")
        for fault, tier in TIERS[: len(OFTEN) + soak_count(len(SELDOM))]
    ],
)
def test_a_planted_fault_is_found(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = COMPARISONS[fault.comparison].default_cases()
    channel = plant(monkeypatch, fault.module, fault.old, fault.new).BluetoothChannel
    for case, slow in cases:
        try:
            if run_channel(case, channel) != slow:
                return
        except (LocalProtocolError, IndexError):  # something was to happen in the past, or taken from an empty queue
            return
    pytest.fail("no case shows it")
