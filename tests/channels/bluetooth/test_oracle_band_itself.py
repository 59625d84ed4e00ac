"""The oracle of the whole band does what the readings say, in scenes worked out by hand."""

from dataclasses import replace
from math import inf

import pytest

from cosim.channels.bluetooth.hopping import basic_channel
from tests.oracles import band_corners
from tests.oracles.band import live
from tests.oracles.band_air import Jammer, Matrix, Mode, Radio
from tests.oracles.band_scene import ALL, Body, Book, Input, Join, Scene, Seen, Send
from tests.oracles.campaign import Seeded
from tests.oracles.medium import SLOT, TICK, US, Clock

FIRST = 4_000
"""Both masters' tick at time 0, or nearly."""
WORD = 0x2A96EF25


# ---------------------------------------------------------------- the oracle itself


def two_piconets(later: int, powers: Matrix, mode: Mode = "co_channel", *sends: Send) -> Scene:
    """Return masters 0 and 2 with the same hop sequence and a slave each, 1 and 3; the second *later* by so many ns.

    Both poll at 1 ms plus 250 us (and *later*).
    """
    bodies = tuple(Body(FIRST * TICK - late, 0, WORD) for late in (0, 0, later, later))
    inputs: tuple[Input, ...] = (Join(0, 0, 1, 1, FIRST + 4), Join(0, 2, 3, 1, FIRST + 4), *sends)
    return Scene(bodies, Radio(((0, powers),), mode=mode), inputs, 6 * SLOT)


def all_equal(dbm: float, count: int = 4, jammers: tuple[float, ...] = ()) -> Matrix:
    rows = [tuple(-inf if a == b else dbm for b in range(count)) for a in range(count)]
    return (*rows, *((power,) * count for power in jammers))


def book_of(scene: Scene) -> Book:
    return live(scene, lambda device, bound, tick: 0)


def frames(book: Book, source: int) -> list[Seen]:
    return sorted((row for row in book.seen + book.idle if row.source == source), key=lambda row: row.start)


@pytest.mark.parametrize(
    ("later", "first", "second"),
    [
        (0, ("collided", "access_code"), ("collided", "access_code")),
        (72 * US - 1, ("collided", "access_code"), ("collided", "access_code")),
        (72 * US, ("collided", "header"), ("collided", "access_code")),
        (126 * US - 1, ("collided", "header"), ("collided", "access_code")),
        (126 * US, ("received", None), ("received", None)),
    ],
)
def test_frames_of_one_channel_collide_where_they_overlap(
    later: int, first: tuple[str, str | None], second: tuple[str, str | None]
) -> None:
    book = book_of(two_piconets(later, all_equal(-50.0)))
    one, other = frames(book, 0)[0], frames(book, 2)[0]
    assert (one.start, other.start) == (1_250_000, 1_250_000 + later)
    assert one.channel == other.channel == basic_channel(WORD, FIRST + 4)
    assert (one.outcome, one.part) == first
    assert (other.outcome, other.part) == second


def test_a_payload_that_collides_is_repeated_though_its_header_was_heard() -> None:
    send = Send(1_000, 0, 1, 27, 5)  # DH1, 366 us
    scene = replace(two_piconets(300 * US, all_equal(-50.0), "co_channel", send), kinds=("DH1",), end=12 * SLOT)
    book = book_of(scene)
    data = [row for row in frames(book, 0) if row.kind == "DH1"]
    assert [(row.start, row.outcome, row.part) for row in data] == [
        (1_250_000, "collided", "payload"),
        (2_500_000, "received", None),
    ]
    answers = frames(book, 1)
    assert [row.start for row in answers] == [1_875_000, 3_125_000]
    assert [delivery.time for delivery in book.deliveries] == [2_500_000 + 366 * US]
    assert [(fate.time, fate.outcome) for fate in book.verdicts] == [(3_125_000 + 126 * US, "delivered")]


@pytest.mark.parametrize(
    ("distance", "stronger_db", "survives"),
    [
        (0, -11.001, True),
        (0, -10.999, False),
        (1, 0.0, True),
        (1, 0.001, False),
        (2, 29.999, True),
        (2, 30.001, False),
        (3, 39.999, True),
        (3, 40.001, False),
        (40, 39.999, True),
        (40, 40.001, False),
    ],
)
def test_a_neighbour_destroys_at_the_specified_ratio(distance: int, stronger_db: float, survives: bool) -> None:
    channel = basic_channel(WORD, FIRST + 4)
    place = channel + distance if channel + distance < 79 else channel - distance
    scene = two_piconets(10 * SLOT, all_equal(-50.0, 4, (-50.0 + stronger_db,)), "neighbouring")
    jammer = Jammer("constant", 1_250_000 + 126 * US - 1, 1_250_000 + 126 * US, (place,))
    scene = replace(scene, radio=replace(scene.radio, jammers=(jammer,)))
    poll = frames(book_of(scene), 0)[0]
    assert (poll.outcome, poll.part) == (("received", None) if survives else ("collided", "header"))
    for mode in ("none", "co_channel"):
        poll = frames(book_of(replace(scene, radio=replace(scene.radio, mode=mode))), 0)[0]
        assert (poll.outcome == "received") == (survives or mode == "none" or distance > 0)


@pytest.mark.parametrize(
    ("at", "part"), [(0, "access_code"), (71_999, "access_code"), (72_000, "header"), (126_000, "payload")]
)
def test_the_section_that_is_hit_first_is_named(at: int, part: str) -> None:
    send = Send(1_000, 0, 1, 27, 5)
    scene = replace(two_piconets(10 * SLOT, all_equal(-50.0, 4, (-50.0,)), "co_channel", send), kinds=("DH1",))
    jammer = Jammer("constant", 1_250_000 + at, 1_250_000 + at + 1, (basic_channel(WORD, FIRST + 4),))
    data = frames(book_of(replace(scene, radio=replace(scene.radio, jammers=(jammer,)))), 0)[0]
    assert (data.kind, data.outcome, data.part) == ("DH1", "collided", part)


def test_at_local_is_the_first_instant_of_that_local_time() -> None:
    choice = Seeded(1)
    clocks = [Clock(choice.integer(0, TICK << 28), choice.integer(-250, 250)) for _ in range(300)]
    for clock in [Clock(0), Clock(1, 250), Clock(1, -250), *clocks]:
        for local in (clock.phase, clock.phase + 1, clock.phase + 4_000, choice.integer(0, TICK << 29)):
            time = clock.at_local(local)
            assert clock.local(time - 1) < local <= clock.local(time)


def test_jammers_sweep_and_pulse() -> None:
    sweep = Jammer("sweeping", 1_000, 10_000, (7, 3, 5), dwell=100)
    assert [7 in sweep.at(time) for time in (999, 1_000, 1_099, 1_100, 1_300, 10_000)] == [0, 1, 1, 0, 1, 0]
    assert sweep.within(1_050, 1_101) == [7, 3]
    assert 5 not in sweep.within(1_050, 1_200)
    assert 5 in sweep.within(1_050, 1_201)
    pulses = Jammer("pulsed", 1_000, 10_000, (7,), on=10, period=100)
    assert [7 in pulses.at(time) for time in (1_009, 1_010, 1_099, 1_100)] == [1, 0, 0, 1]
    assert 7 not in pulses.within(1_010, 1_100)
    assert 7 in pulses.within(1_010, 1_101)
    assert 7 not in pulses.within(10_000, 20_000)


def test_powers_count_from_the_frames_start_for_the_carrier_and_at_its_end_for_the_interferer() -> None:
    loud, faint = all_equal(-50.0), all_equal(-70.0)
    begin, end = 1_250_000, 1_250_000 + 126 * US
    noisy = replace(two_piconets(1 * US, loud).radio, noise_dbm=-69.0)

    def poll(*powers: tuple[int, Matrix]) -> str:
        scene = replace(two_piconets(1 * US, loud), radio=replace(noisy, powers=powers))
        return frames(book_of(scene), 0)[0].outcome

    only_0 = tuple(row if a == 0 else (-inf,) * 4 for a, row in enumerate(loud))
    assert poll((0, loud)) == "collided"
    assert poll((0, loud), (end, only_0)) == "received"  # the interferer has gone by the end
    assert poll((0, loud), (end + 1, only_0)) == "collided"
    assert poll((0, only_0), (end, loud)) == "collided"
    assert poll((0, only_0), (begin + 1, faint)) == "received"  # -61 dBm would do, and the carrier is still -50
    assert poll((0, only_0), (begin, faint)) == "out_of_range"


def test_a_radio_that_is_off_neither_hears_nor_disturbs() -> None:
    scene = two_piconets(0, all_equal(-50.0))
    off = replace(scene, radio=replace(scene.radio, switches=((1_250_000 + 126 * US, 2, False),)))
    assert frames(book_of(off), 0)[0].outcome == "received"
    assert frames(book_of(off), 2)[0].outcome == "collided"  # on when the frame began
    off = replace(scene, radio=replace(scene.radio, switches=((1_250_000, 2, False), (1_250_001, 2, True))))
    assert [frames(book_of(off), source)[0].outcome for source in (0, 2)] == ["collided", "out_of_range"]


def test_a_frame_below_the_noise_is_out_of_range_and_one_above_has_bit_errors() -> None:
    scene = two_piconets(10 * SLOT, all_equal(-50.0), "none")
    outcomes = {
        noise: frames(book_of(replace(scene, radio=replace(scene.radio, noise_dbm=noise))), 0)[0].outcome
        for noise in (-49.999, -50.0, -80.0)
    }
    assert outcomes == {-49.999: "out_of_range", -50.0: "bit_errors", -80.0: "received"}


def test_errors_depend_on_the_key_and_hit_each_receiver_by_itself() -> None:
    """Of broadcasts of 339 bytes at 13.6 dB about a half arrive at each of two slaves, not at both or none."""
    bodies = tuple(Body(FIRST * TICK, 0, WORD) for _ in range(3))
    inputs: list[Input] = [Join(0, 0, 1, 1, FIRST + 4), Join(0, 0, 2, 2, FIRST + 4)]
    inputs += [Send(1_000, 0, ALL, 339, token) for token in range(30)]
    radio = Radio(((0, all_equal(-50.0, 3)),), noise_dbm=-63.6, key=(1, 2))
    scene = Scene(bodies, radio, tuple(inputs), 300 * SLOT)

    def heard(scene: Scene) -> list[set[int]]:
        book = book_of(scene)
        return [{row.token for row in book.deliveries if row.receiver == slave} for slave in (1, 2)]

    one, other = heard(scene)
    assert 3 < len(one) < 27
    assert 3 < len(other) < 27
    assert one != other
    assert heard(replace(scene, radio=replace(radio, key=(1, 3)))) != [one, other]


# ---------------------------------------------------------------- slow hosts


MS = 1_000_000


def data(book: Book, kind: str = "DH5") -> list[tuple[int, str]]:
    return [(row.start, row.outcome) for row in sorted(book.seen) if row.kind == kind]


@pytest.mark.parametrize(
    ("length", "bps", "delivered", "again"),
    [(246, 246_000, 11_376_000, 12_500_000), (250, 251_004, 11_376_001, 22_500_000)],
)
def test_a_slaves_place_is_free_at_the_delivery(length: int, bps: int, delivered: int, again: int) -> None:
    """The POLL of 11.25 ms ends at 11.376 ms, the next one follows at 21.25 ms; data go two slots after a "go"."""
    book = book_of(band_corners.place_of_the_slave(length, bps).scene)
    assert data(book) == [(1_250_000, "received"), (again, "received")]
    assert book.deliveries[0].time == delivered
    assert [(row.time, row.outcome) for row in book.verdicts] == [
        (1_250_000 + 5 * SLOT + 126 * US, "delivered"),
        (again + 5 * SLOT + 126 * US, "delivered"),
    ]


@pytest.mark.parametrize(
    ("length", "bps", "delivered", "again"),
    [(335, 409_974, 17_500_000, 17_500_000), (300, 352_061, 17_500_001, 27_500_000)],
)
def test_a_masters_place_is_free_at_the_delivery(length: int, bps: int, delivered: int, again: int) -> None:
    """Polls at 7.5, 17.5 and 27.5 ms: a slave with a payload answers NULL to the one that says "stop"."""
    book = book_of(band_corners.place_of_the_master(length, bps).scene)
    assert data(book) == [(7_500_000 + SLOT, "received"), (again + SLOT, "received")]
    assert book.deliveries[0].time == delivered


def one_slave(lost: tuple[tuple[int, int], ...], *sends: Send, ms: int = 100, slaves: int = 1) -> Scene:
    """Return a master 0 with slaves, polled every 10 ms from 7.5 ms on; 27 bytes take *ms* to a host, one has a place.

    From slave 1 nothing arrives in the times *lost*.
    """
    whole = all_equal(-50.0, slaves + 1)
    mute = tuple(row if source != 1 else (-inf,) * (slaves + 1) for source, row in enumerate(whole))
    powers = [(0, whole)] + [piece for start, until in lost for piece in ((start, mute), (until, whole))]
    bodies = tuple(Body(FIRST * TICK, 0, WORD) for _ in range(slaves + 1))
    joins = tuple(Join(0, 0, slave, slave, FIRST + 24 + 4 * slave) for slave in range(1, slaves + 1))
    radio = Radio(tuple(powers))
    rate = 27 * 8 * 1_000 // ms
    return Scene(bodies, radio, (*joins, *sends), 400 * SLOT, t_poll=16, kinds=("DH1",), host_bps=rate, room=1)


def test_a_payload_without_a_place_is_refused_and_its_header_counts() -> None:
    """The poll of 11.25 ms says "stop" and is not heard, so the next payload goes, in vain; the slave's own is sent."""
    sends = Send(1_000, 0, 1, 27, 1), Send(1_001, 0, 1, 27, 2), Send(12_000_000, 1, 0, 27, 3)
    book = book_of(one_slave(((11 * MS, 12 * MS),), *sends))
    assert data(book, "DH1")[:4] == [
        (1_250_000, "received"),
        (12_500_000, "refused"),
        (13_125_000, "received"),
        (103_750_000, "received"),
    ]
    lost = [row for row in book.seen + book.idle if row.start == 11_250_000 + SLOT]
    assert [(row.kind, row.outcome) for row in lost] == [("NULL", "out_of_range")]
    fates = {row.token: row.time for row in book.verdicts}
    assert fates[1] == 1_250_000 + SLOT + 126 * US
    assert fates[3] == 22_500_000 + 126 * US  # by the next poll, 10 ms after the refused packet
    assert fates[2] == 103_750_000 + SLOT + 126 * US  # the poll of 102.5 ms was the first to be told "go"


def test_hosts_get_broadcasts_in_their_turn_and_these_need_no_place() -> None:
    sends = Send(1_000, 0, 1, 27, 1), Send(1_001, 0, ALL, 27, 2), Send(1_002, 0, ALL, 27, 3), Send(1_003, 0, 1, 0, 4)
    book = book_of(one_slave((), *sends, ms=4))
    assert [(row.start, row.lt_addr) for row in sorted(book.seen) if row.kind == "DH1"] == [
        (1_250_000, 1),
        (2_500_000, 0),
        (3_750_000, 0),
        (12_500_000, 1),  # the place was free at 5.6 ms, which the poll of 11.25 ms was told
    ]
    first = 1_250_000 + 366 * US + 4 * MS
    assert [(row.time, row.token) for row in book.deliveries] == [
        (first, 1),
        (first + 4 * MS, 2),
        (first + 8 * MS, 3),
        (first + 8 * MS + 1, 4),
    ]


def test_a_payload_for_another_slave_overtakes_and_a_broadcast_does_not() -> None:
    sends = [Send(1_000, 0, to, 27, token) for token, to in enumerate((1, 1, 2, ALL))]
    book = book_of(one_slave((), *sends, slaves=2))
    assert [(row.start, row.destination) for row in sorted(book.seen) if row.kind == "DH1"][:2] == [
        (1_250_000, 1),
        (2_500_000, 2),
    ]
    broadcast = next(row for row in sorted(book.seen) if row.lt_addr == 0)
    assert broadcast.start > 100 * MS
