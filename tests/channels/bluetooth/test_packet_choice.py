"""The choice of packet types: the smallest that fits, or the best at the Es/N0 that the link has now."""

import numpy as np
import pytest

from cosim.channels.bluetooth.bits.errors import section_errors
from cosim.channels.bluetooth.medium import Noise
from cosim.channels.bluetooth.packets import ACL
from cosim.machine import BROADCAST
from cosim.units import MS, Time
from tests.channels.bluetooth.piconet_bench import Bench


def noisy_bench(size: int, es_n0_db: float, **settings: object) -> Bench:
    """A bench on which everybody receives everybody with *es_n0_db*."""
    bench = Bench(size, idle=False, **settings)
    bench.air.noise = Noise(-100.0, 0, 0)
    set_es_n0(bench, es_n0_db)
    return bench


def set_es_n0(bench: Bench, es_n0_db: float, *pairs: tuple[int, int]) -> None:
    powers = bench.air.medium.power_dbm.copy()
    if not pairs:
        powers[:] = es_n0_db - 100.0
        np.fill_diagonal(powers, -np.inf)
    for pair in pairs:
        powers[pair] = es_n0_db - 100.0
    bench.air.set_powers(powers, bench.kernel.now)
    bench.air.changed(bench.kernel.now)


def first_kind(bench: Bench, until: Time = 100 * MS) -> str:
    bench.run(until)
    return next(frame.kind for frame, _ in bench.frames if frame.length)


def rate(name: str, length: int, es_n0_db: float) -> float:
    """Expected bytes a slot, by the exact probabilities."""
    access, header, payload = section_errors(ACL[name], length, es_n0_db)
    return float(((1 - access) * (1 - header)) ** 2 * (1 - payload)) * length / (ACL[name].slots + 1)


@pytest.mark.parametrize("source", [0, 1])
@pytest.mark.parametrize(
    ("length", "es_n0_db", "kind"),
    [
        (17, 10.0, "DM1"),
        (20, 10.0, "DM3"),  # DH1 would do, but breaks nine times of ten
        (20, 16.0, "DH1"),
        (150, 11.0, "DM5"),
        (150, 20.0, "DH3"),
        (224, 12.0, "DM5"),
    ],
)
def test_best_packets_are_those_of_the_highest_expected_rate(
    source: int, length: int, es_n0_db: float, kind: str
) -> None:
    fitting = [name for name in ACL if ACL[name].capacity >= length]
    assert max(fitting, key=lambda name: rate(name, length, es_n0_db)) == kind
    bench = noisy_bench(1, es_n0_db, best_packets=True, t_poll_slots=16, first_due=4)
    bench.send(0, source, 1 - source, bytes(length))
    assert first_kind(bench) == kind


def test_without_the_wish_the_smallest_type_is_taken() -> None:
    bench = noisy_bench(1, 10.0, first_due=4)
    bench.send(0, 0, 1, bytes(20))
    assert first_kind(bench) == "DH1"


def test_each_direction_has_its_own_link_and_a_broadcast_goes_by_the_worst() -> None:
    for source, destination, kind in ((0, 1, "DH3"), (1, 0, "DM5"), (0, BROADCAST, "DM5")):
        bench = noisy_bench(2, 20.0, best_packets=True, first_due=4)
        set_es_n0(bench, 11.0, (1, 0), (0, 2))
        bench.send(0, source, destination, bytes(150))
        assert first_kind(bench) == kind


def test_the_link_counts_as_it_is_when_the_payload_is_first_sent() -> None:
    bench = noisy_bench(1, 20.0, best_packets=True, first_due=4000)
    bench.kernel.at(0, bench.piconet.suspend)
    bench.send(1 * MS, 0, 1, bytes(150))
    bench.kernel.at(2 * MS, lambda: set_es_n0(bench, 11.0))
    bench.kernel.at(3 * MS, bench.piconet.resume)
    assert first_kind(bench) == "DM5"


def test_a_payload_keeps_its_type_when_it_is_repeated() -> None:
    bench = noisy_bench(1, 20.0, best_packets=True, first_due=4000)
    bench.kernel.at(0, lambda: set_es_n0(bench, -20.0, (1, 0)))  # no acknowledgement is heard
    bench.send(1, 0, 1, bytes(150), token=1)
    bench.kernel.at(20 * MS, lambda: set_es_n0(bench, 11.0, (0, 1)))
    bench.kernel.at(40 * MS, lambda: set_es_n0(bench, 20.0))
    bench.run(60 * MS)
    kinds = [frame.kind for frame, _ in bench.frames if frame.length]
    assert len(kinds) > 8
    assert set(kinds) == {"DH3"}
    assert len(bench.fates()) == 1
