"""100,000 packets of Bluetooth Low Energy of runs that are drawn: tshark finds none of them malformed."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST
from cosim.channels.propagation import PropagationSettings
from cosim.export.capture import write_capture
from cosim.machine import BROADCAST, Disconnect, Flush, Inquire, Page, Scan, Sniff
from cosim.trace import TRANSMISSIONS
from cosim.units import MS, S
from tests.channels.ble.ble_field import Field
from tests.export.capture_reading import find_tshark, read_fields
from tests.tiers import soak_count

PACKETS = 100_000
PHYS = ("1M", "2M", "coded")
LENGTHS = (0, 1, 19, 20, 21, 50, 243, 244, 245, 244, 600, 3_000)
"""Payloads in octets, most of them near the longest of one packet."""
KINDS = {
    *("ADV_IND", "ADV_NONCONN_IND", "ADV_EXT_IND", "AUX_ADV_IND", "AUX_CHAIN_IND", "CONNECT_IND"),
    *("SCAN_REQ", "SCAN_RSP", "EMPTY", "DATA", "CONTROL"),
}
WAYS = ("extended", "legacy", "mesh")
ERROR = 0x800000
"""Severity of an error, in tshark's words."""


def settings_in(random: Random, number: int) -> dict[str, Any]:
    """Draw what devices do; the PHYs of links and of payloads for all come in turn, each with each."""
    link, broadcast = PHYS[number % 3], PHYS[number // 3 % 3]
    connection = {
        "interval_s": random.choice((0.0375, 0.05, 0.1) if link == "coded" else (0.0075, 0.03, 0.05)),
        "latency": random.choice((0, 0, 3)),
        "phy": link,
        "octets": random.choice((27, 100, 251)),
        "links": random.choice((None, 1)),
    }
    by = WAYS[number % 3] if broadcast == "1M" else "extended"
    repeated = {"events": random.choice((1, 3)), "interval_s": random.choice((0.02, 0.05))}
    return {
        "connection": connection,
        "broadcast": {"by": by, "phy": broadcast, **({} if by == "mesh" else repeated)},
        "advertise": {"interval_s": random.choice((0.02, 0.1, 0.2))},
        "scan": {"interval_s": 0.03, "window_s": random.choice((0.01, 0.03)), "active": random.random() < 0.5},
        "clock_ppm": random.choice((0, 20, 500)),
        "idle_frames": random.random() < 0.3,
        "interference": random.choice(("none", "band")),
        "propagation": random.choice((None, PropagationSettings())),
    }


def happenings(field: Field, size: int, random: Random) -> list[Callable[[], object]]:
    """Return what may happen next: payloads, searches, links that come and go, robots that move or are switched."""
    one, other = random.sample(range(size), 2)
    payload = random.randbytes(random.choice(LENGTHS))
    longer = random.randbytes(random.randint(0, LONGEST_BROADCAST))
    places_m = [(random.uniform(0, 60), random.uniform(0, 60)) for _ in range(size)]
    sends = [lambda: field.send(one, other, payload)] * 4
    return [
        *sends,
        lambda: field.send(one, BROADCAST, longer),
        lambda: field.send(one, BROADCAST, payload),
        lambda: field.do(one, Page(other)),
        lambda: field.do(one, Page(other)),
        lambda: field.do(one, random.choice((Disconnect(other), Flush(other), Flush(BROADCAST)))),
        lambda: field.do(one, Inquire(random.randint(1, 2_000) * MS, random.randint(1, size))),
        lambda: field.do(one, Scan(random.random() < 0.8)),
        lambda: field.do(one, Sniff(other, random.randint(0, 800), 0, 2)),
        lambda: field.move(places_m),
        lambda: field.channel.power(one, random.random() < 0.8),
    ]


def drawn_run(number: int) -> Field:
    """Return run *number*: a team in which something happens every 20 ms or so."""
    random = Random(f"capture {number}")
    size = random.randint(3, 6)
    field = Field(size, number, (TRANSMISSIONS,), **settings_in(random, number))
    for address in range(size):
        field.do(address, Scan(True))
    field.do(0, *(Page(peer) for peer in range(1, size)))
    field.until(2 * S)
    end = field.kernel.now + 4 * S
    while field.kernel.now < end:
        random.choice(happenings(field, size, random))()
        field.until(field.kernel.now + random.randint(1, 40 * MS))
    for address in range(size):
        field.channel.power(address, False)
    field.until(field.kernel.now + S)
    return field


def is_faulty(row: list[str]) -> bool:
    """Return whether tshark takes a packet for malformed, or finds an error in it."""
    malformed, severities, *_ = row
    return bool(malformed) or any(int(each) >= ERROR for each in severities.split(",") if each)


@pytest.mark.soak
def test_tshark_finds_no_packet_of_any_run_malformed(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    tshark, count, number = find_tshark(), soak_count(PACKETS), 0
    kinds, phys = Counter[str](), Counter[str]()
    while kinds.total() < count or number < len(PHYS):
        field = drawn_run(number)
        path = tmp_path / f"{number}.pcapng"
        written = write_capture(path, field.channel, field.trace, "")
        rows = read_fields(tshark, path, ["_ws.malformed", "_ws.expert.severity", "_ws.expert.message", "btle_rf.phy"])
        assert len(rows) == written
        assert not (wrong := [row for row in rows if is_faulty(row)]), (number, wrong[:5])
        kinds.update(field.trace.columns(TRANSMISSIONS.name)["kind"])
        phys.update(PHYS[int(phy, 0)] for *_, phy in rows)
        number += 1
    assert (set(kinds), set(phys)) == (KINDS, set(PHYS)), (kinds, phys)
    record_property("packets of Low Energy that tshark has read", kinds.total())
    print(f"{kinds.total()} packets of {number} runs, 0 malformed: {dict(kinds)}, {dict(phys)}")
