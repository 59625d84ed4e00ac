"""802.11, Bluetooth and LE in one air: what each notices of the other, told anew from the tables of a run."""

from collections import deque
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim.channels.adhoc.phy import noise_dbm
from cosim.channels.air.band import Emission
from cosim.channels.air.spectra import CLASSIC, DSSS, LE_1M, OFDM, shares
from cosim.channels.ble.bits.errors import noise_mw
from cosim.channels.ble.phy import LE_1M as PHY_1M
from cosim.channels.bluetooth.bits.powers import POWER_DBM
from cosim.channels.bluetooth.reporting import tenancy
from cosim.channels.bluetooth.settings import BluetoothSettings
from cosim.kernel import DELIVER, WORLD, Kernel
from cosim.machine import BROADCAST, Inquire, Outgoing, Page, Scan
from cosim.scenario import Scenario
from cosim.simulation import simulate
from cosim.units import MS, US, S
from tests.channels.air.shared_field import SharedField

BLE, WIFI = 0, 1  # numbers of radios; in place of LE it may be Bluetooth
WIFI_MHZ = 2437
SLOT_PAIR = 1250 * US
TABLES = ("transmissions", "receptions")
Row = dict[str, Any]


def field(seed: int, classic: bool, **settings: Any) -> SharedField:
    """Return robots 0 and 1 with LE, or Bluetooth, 2 and 3 with 802.11, and 4 with both, at places of their own."""
    random = np.random.default_rng((28, seed))
    places = random.uniform(0.0, 12.0, (5, 2)).tolist()
    rate = float(random.choice((1, 2, 5.5, 11)))
    phy = {"phy": "erp", "rate_mbps": 24} if seed % 3 == 0 else {"phy": "dsss", "rate_mbps": rate}
    ble = {"kind": "ble", "connection": {"interval_s": 0.0075}, "power_dbm": float(random.choice((0, 8)))}
    adhoc = {"kind": "adhoc", "channel": 6, "power_dbm": float(random.choice((0, 15))), **phy}
    if classic:
        idle = {"idle_frames": True, "t_poll_slots": 16, "interference": "neighbouring"}
        ble = {"kind": "bluetooth", "power_class": int(random.choice((2, 3))), **idle}
    carried = [(BLE,)] * 2 + [(WIFI,)] * 2 + [(BLE, WIFI)]
    return SharedField([ble, adhoc], places, carried, seed=seed, **settings)


def busy(field: SharedField, seed: int, since: int, until: int) -> None:
    """Make links from robot 0, and have all hosts say something at random times *since* an instant *until* another.

    The tables have neither advertisements nor IDs that nobody has listened to: there are none after *since*.
    """
    random = np.random.default_rng((29, seed))
    field.at(MS, 0, Page(1), Page(4))
    field.until(since - 100 * MS)
    for robot in (0, 1, 4):
        field.at(field.kernel.now, robot, Scan(False))
    for at in range(since, until, 137 * MS):
        places = field.places_at(since) + random.uniform(-1.0, 1.0, (5, 2))
        field.kernel.at(at, partial(field.move, places), WORLD)
    for _ in range(150):
        at, octets = int(random.integers(since, until - 200 * MS)), int(random.integers(1, 1200))
        field.at(at, 0, Outgoing(int(random.choice((1, 4, BROADCAST))), bytes(octets % 200)))
        source, destination = random.choice((2, 3, 4), 2, replace=False).tolist()
        for _ in range(int(random.integers(1, 6))):
            field.at(at + int(random.integers(5 * MS)), source, Outgoing(destination, bytes(octets), None, WIFI))
    field.until(until)


def gain(field: SharedField, a: int, b: int, time: int) -> float:
    """Return the law of free space by itself at *time*, or the isolation within a robot."""
    if a == b:
        return float(10 ** (-20.0 / 10))
    places = field.places_at(time)
    distance = max(0.1, float(np.hypot(*(places[a] - places[b]))))
    return float(10 ** (-(40.2 + 20.0 * np.log10(distance)) / 10))


class Told:
    """The rows of a run, of both radios."""

    def __init__(self, field: SharedField) -> None:
        self.field = field
        field.close()
        self.sent = sorted(field.rows("transmissions"), key=lambda row: row["time_ns"])
        self.heard = field.rows("receptions")
        ble, wifi = field.channel.parts
        self.settings = {BLE: ble.settings, WIFI: wifi._settings}
        self.classic = isinstance(ble.settings, BluetoothSettings)
        self.kinds = {
            BLE: CLASSIC if self.classic else LE_1M,
            WIFI: OFDM if self.settings[WIFI].phy == "erp" else DSSS,
        }
        self.starts = np.array([row["time_ns"] for row in self.sent])
        self.longest = max(row["duration_ns"] for row in self.sent)

    def mw(self, radio: int) -> float:
        settings = self.settings[radio]
        dbm = POWER_DBM[settings.power_class] if radio == BLE and self.classic else settings.power_dbm
        return float(10 ** (dbm / 10))

    def steps(self, one: Row, other: Row) -> int:
        """Return how far the centres are apart, in steps of 0.5 MHz."""
        return abs(self.centre(one) - self.centre(other))

    def centre(self, row: Row) -> int:
        return 2 * (2402 + int(row["channel"])) if row["radio"] == BLE else 2 * WIFI_MHZ

    def foreign(self, row: Row, receiver: int, begin: int, end: int) -> list[tuple[int, int, float]]:
        """Return (begin, end, mW behind the filter of the *receiver* of *row*) of what others send meanwhile."""
        near = range(*np.searchsorted(self.starts, (begin - self.longest, end)))
        found = []
        for other in (self.sent[at] for at in near):
            over = other["time_ns"] + other["duration_ns"]
            if other["radio"] != row["radio"] and other["time_ns"] < end and over > begin:
                part = float(shares()[self.kinds[other["radio"]], self.kinds[row["radio"]], self.steps(row, other)])
                mw = self.mw(other["radio"]) * gain(self.field, other["source"], receiver, other["time_ns"]) * part
                if mw > 1e-14:
                    found.append((other["time_ns"], over, mw))
        return found

    def worst_mw(self, row: Row, receiver: int, begin: int, end: int) -> float:
        """Return the most that comes together in any instant of [begin, end)."""
        found = self.foreign(row, receiver, begin, end)
        instants = [begin, *(start for start, _, _ in found if start > begin)]
        return max(sum(mw for start, over, mw in found if start <= at < over) for at in instants)

    def transmission(self, heard: Row) -> Row:
        at = int(np.searchsorted(self.starts, heard["time_ns"]))
        same = ("time_ns", "source", "radio")
        return next(row for row in self.sent[at:] if all(row[name] == heard[name] for name in same))


@pytest.mark.parametrize("classic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_worst_ratio_of_every_frame_is_that_of_the_tables(seed: int, classic: bool) -> None:
    field_ = field(seed, classic)
    since = 12 * S if classic else S // 2
    until = since + 5 * S // 2
    busy(field_, seed, since, until)
    told = Told(field_)
    settings = told.settings
    noises = {
        BLE: 10 ** (settings[BLE].noise_dbm / 10) if classic else noise_mw(PHY_1M, settings[BLE].sensitivity_dbm),
        WIFI: 10 ** (noise_dbm(settings[WIFI].radio.bandwidth_hz, settings[WIFI].noise_figure_db) / 10),
    }
    disturbed = {BLE: 0, WIFI: 0}
    for heard in told.heard:
        row, radio = told.transmission(heard), heard["radio"]
        if not since <= heard["time_ns"] < until - 100 * MS or heard["sinr_db"] is None:
            continue  # what they have met may be in no table: advertisements, and what is not over
        late = US if radio == WIFI else 0  # 802.11 has a delay of propagation
        begin, end = row["time_ns"] + late, row["time_ns"] + row["duration_ns"] + late
        own = [
            each
            for each in told.sent
            if each["radio"] == radio and each is not row
            and each["time_ns"] < end and each["time_ns"] + each["duration_ns"] + late > row["time_ns"]
        ]  # fmt: skip
        if own:
            continue  # it has also met its like
        of = row, heard["receiver"]
        worst = told.worst_mw(*of, begin, end)
        disturbed[radio] += worst > 0
        starts = [start for start, _, _ in told.foreign(*of, begin, end)]
        if any(start - SLOT_PAIR < move < start for move, _ in field_.moves for start in starts):
            continue  # an answer is told with the gains of when it is known, 0.15 ms or up to two slots before
        signal = 10 ** (heard["power_dbm"] / 10)
        expected = 10 * np.log10(signal / (noises[radio] + worst))
        assert heard["sinr_db"] == pytest.approx(expected, abs=1e-6), (heard, row)
    assert min(disturbed.values()) > 10


# ---------------------------------------------------------------- listening before talking


def begins_within(sent: list[Row], spans: list[tuple[int, int]], after: int) -> int:
    """Return how many frames that had to contend begin in one of *spans*, later than *after* its begin."""
    return sum(any(start + after < row["time_ns"] < end for start, end in spans) for row in sent)


@pytest.mark.parametrize(("distance_m", "defers"), [(12.3, True), (12.4, False)])
def test_a_station_hears_a_carrier_of_0_dbm_as_far_as_12_3_m(distance_m: float, defers: bool) -> None:
    """40.2 + 20 lg 12.3 = 62.0 dB in free space, and energy of -62 dBm makes the medium busy."""
    link = {"interval_s": 0.0075, "phy": "coded"}
    radios = [{"kind": "ble", "connection": link}, {"kind": "adhoc", "channel": 6, "rate_mbps": 11}]
    field_ = SharedField(radios, [(0, 0), (0.01, 0), (distance_m, 0), (distance_m + 1, 0)], [(0,), (0,), (1,), (1,)])
    field_.at(0, 0, Page(1))
    for number in range(400):
        field_.at(S + number * 7 * MS, 0, Outgoing(1, bytes(100)))
    for number in range(1500):
        field_.at(S + number * 1_777_777, 2, Outgoing(3, bytes(20), None, WIFI))
    field_.until(4 * S)
    told = Told(field_)
    loud = [
        (row["time_ns"], row["time_ns"] + row["duration_ns"])
        for row in told.sent
        if row["radio"] == BLE and row["source"] == 0 and abs(told.centre(row) - 2 * WIFI_MHZ) <= 18
    ]
    data = [row for row in told.sent if row["radio"] == WIFI and row["kind"] == "DATA"]
    assert len(data) > 1000
    sensed = settings_cca(field_)
    assert (begins_within(data, loud, sensed) == 0) == defers
    assert begins_within(data, [(end, end + MS) for _, end in loud], 0) > 20


def settings_cca(field_: SharedField) -> int:
    return field_.channel.parts[WIFI]._settings.timing().cca


def test_a_station_hears_advertisements_that_nobody_scans_for() -> None:
    radios = [{"kind": "ble", "advertise": {"interval_s": 0.02}}, {"kind": "adhoc", "channel": 4, "rate_mbps": 11}]
    field_ = SharedField(radios, [(0, 0), (5, 0), (6, 0)], [(0,), (1,), (1,)])
    for number in range(2000):
        field_.at(S + number * 500_003, 1, Outgoing(2, bytes(20), None, WIFI))
    field_.until(3 * S)
    told = Told(field_)
    beacon = field_.channel.parts[BLE].devices[0].station.beacon
    loud = [(sent.start, sent.end) for sent in beacon.packets(S, 2 * S) if sent.centre_mhz == 2426]
    data = [row for row in told.sent if row["kind"] == "DATA"]
    assert len(data) == 2000
    assert len(loud) > 35
    assert begins_within(data, loud, settings_cca(field_)) == 0
    assert begins_within(data, [(end, end + MS) for _, end in loud], 0) > 20


# ---------------------------------------------------------------- catching up


@pytest.mark.parametrize("classic", [False, True])
def test_who_catches_up_when_changes_nothing(classic: bool) -> None:
    """The air may be asked, and so have all catch up, at any instants."""

    def played(asks: int) -> list[Any]:
        field_ = field(7, classic)
        air = field_.channel._air
        assert air is not None
        for at in np.random.default_rng(5).integers(1, since + S, asks).tolist():
            field_.kernel.at(at, lambda: air.band.settle(field_.kernel.now), DELIVER)
        busy(field_, 7, since, since + 3 * S // 2)
        field_.close()
        rows = (row for name in TABLES for row in field_.rows(name))
        return sorted(sorted((name, str(value)) for name, value in row.items()) for row in rows)

    since = 12 * S if classic else S // 2
    alone = played(0)
    assert len(alone) > 1000
    assert played(3000) == alone


def test_a_station_hears_the_ids_of_an_inquiry() -> None:
    """Two IDs in each TX slot, on the 32 channels of the inquiry, each of them told as it begins."""
    radios = [{"kind": "bluetooth", "power_class": 2}, {"kind": "adhoc", "channel": 6, "rate_mbps": 11}]
    field_ = SharedField(radios, [(0, 0), (5, 0), (6, 0)], [(0,), (1,), (1,)])
    air = field_.channel._air
    assert air is not None
    heard: list[tuple[int, Emission]] = []
    tell = air.tell

    def noted(emission: Emission) -> None:
        heard.append((field_.kernel.now, emission))
        tell(emission)

    air.tell = noted  # type: ignore[method-assign]
    field_.at(S, 0, Inquire(8 * S, 1))
    for number in range(4000):
        field_.at(2 * S + number * 1_000_003, 1, Outgoing(2, bytes(200), None, WIFI))
    field_.until(6 * S)
    ids = [(at, each) for at, each in heard if each.tenant == BLE and 2 * S + 50 * MS <= each.start < 5 * S]
    assert len(ids) == pytest.approx(2 * (3 * S - 50 * MS) / (1250 * US), abs=2)
    starts = np.array([each.start for _, each in ids])
    assert np.array_equal(np.unique(np.round(np.diff(starts) / 100)), [3125, 9375])
    assert len({each.centre for _, each in ids}) == 32
    told = Told(field_)
    data = [row for row in told.sent if row["kind"] == "DATA"]
    loud = [(each.start, each.end) for _, each in ids if abs(each.centre - 2 * WIFI_MHZ) <= 18]
    assert len(data) > 3000
    assert begins_within(data, loud, settings_cca(field_)) == 0
    assert begins_within(data, [(end, end + MS) for _, end in loud], 0) > 20


@pytest.mark.parametrize("kind", ["bluetooth", "ble"])
def test_an_air_in_which_one_kind_speaks_is_as_its_own(kind: str) -> None:
    """A run in which the stations are silent has the digest that it has apart."""

    def digest(air: str) -> str:
        law = {"propagation": {"model": "log_distance"}}
        wifi = {"kind": "adhoc", "channel": 6, **law}
        scenario = Scenario.model_validate(
            {
                "name": "silent",
                "duration_s": 120,
                "floorplan": {"map": "office"},
                "team": {"size": 3, "radios": [0, 1], "body": {"radius_m": 0.2, "speed_mps": 0.5, "drive": "grid"}},
                "channel": {"kind": "radios", "air": air, "radios": [{"kind": kind, **law}, wifi]},
                "protocol": {"use": "pseudonet", "parameters": {"algorithm": "spanning_tree"}},
            }
        )
        return simulate(scenario, 3).digest

    assert digest("shared") == digest("apart")


# ---------------------------------------------------------------- who need not be advanced


class Advanced:
    """Piconets of which nothing begins by itself, and when they were advanced for others."""

    neighbours: tenancy.Tenancy | None = None
    band = SimpleNamespace(piconets=np.zeros((0, 1), np.int64), links=np.zeros((0, 1, 1), np.int64))
    medium = SimpleNamespace(trains=(), frames=np.zeros((0, 1, 2)))

    def __init__(self) -> None:
        self.sent = deque[Any]()
        self.times: list[int] = []

    def advance(self, now: int, last_end: int | None = None) -> None:
        if self.neighbours is not None:
            self.neighbours.gather(now)
        self.times.append(now)

    def changed(self, now: int) -> None:
        pass


@pytest.mark.parametrize("between", ["nothing", "decided", "alone"])
def test_bluetooth_is_advanced_for_others_when_something_of_it_may_have_begun(
    monkeypatch: pytest.MonkeyPatch, between: str
) -> None:
    monkeypatch.setattr(tenancy, "next_start", lambda *_: 1 << 62)
    band = SimpleNamespace(gather=lambda *_: None, table=None)
    air = SimpleNamespace(join=lambda _: 0, band=band, reconsider_soon=lambda: None)
    kernel, piconets = Kernel(), Advanced()
    tenant = tenancy.Tenancy(air, kernel, np.zeros(2), piconets)  # type: ignore[arg-type]
    tenant.others_changed(False)
    kernel.run(MS)
    tenant.catch_up(MS)
    kernel.run(2 * MS)
    if between == "alone":
        tenant.others_changed(True)
        tenant.others_changed(False)
    elif between == "decided":
        piconets.advance(2 * MS)
    kernel.run(3 * MS)
    piconets.times.clear()
    tenant.catch_up(3 * MS)
    assert piconets.times == ([] if between == "nothing" else [3 * MS])
