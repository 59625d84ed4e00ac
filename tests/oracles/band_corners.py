"""Scenes made by hand for the comparison of channel and oracle: corners that random scenes hardly ever meet."""

from dataclasses import replace
from math import inf

from cosim.channels.bluetooth.hopping import basic_channel
from tests.oracles.band_air import Jammer, Matrix, Radio
from tests.oracles.band_cases import Case
from tests.oracles.band_scene import Body, Input, Inquire, Join, PageFor, ScanWindows, Scene, Send
from tests.oracles.medium import SLOT, TICK, US

FIRST = 4_000
WORD = 0x2A96EF25
DUE = FIRST + 24
"""A poll 7.5 ms after time 0, when the air has become calm."""
POLL = 24 * TICK


def corners() -> list[Case]:
    """Return all of them, with idle frames counted and recorded."""
    cases = [
        begun_beside_an_idle_poll(),
        interferer_gone_at_the_end(),
        jammer_gone_at_the_end(),
        page_in_calm_air(),
        touching_polls(126 * US),
        touching_polls(-126 * US),
        loud_jammer_two_channels_away(),
        master_that_does_not_hear(),
        page_in_the_midst_of_a_pair(),
        equal_replies(),
        leaves_in_the_midst_of_a_poll(),
        full_of_an_earlier_link(),
        full_of_an_earlier_link(turned=True),
        place_of_the_slave(246, 246_000),
        place_of_the_slave(250, 251_004),
        place_of_the_master(335, 409_974),
        place_of_the_master(300, 352_061),
    ]
    return cases + [replace(case, idle=not case.idle) for case in cases]


def equal_powers(size: int, jammers: int = 0) -> Matrix:
    rows = [tuple(-inf if a == b else 0.0 for b in range(size)) for a in range(size)]
    return (*rows, *((0.0,) * size,) * jammers)


def bodies(*later: int) -> tuple[Body, ...]:
    """Return devices with one hop sequence, their slots *later* than those of the first by so many ns."""
    scans = ScanWindows(18, 36), ScanWindows(0, 36)
    return tuple(Body(FIRST * TICK - late, 0, WORD, *scans) for late in later)


def begun_beside_an_idle_poll() -> Case:
    """A second piconet begins 1 ns after the POLL of one that was alone, and polls 60 us after it."""
    joins = (Join(0, 0, 1, 1, DUE), Join(POLL + 1, 2, 3, 1, DUE))
    scene = Scene(bodies(0, 0, 60 * US, 60 * US), Radio(((0, equal_powers(4)),)), joins, 40 * SLOT)
    return Case(scene, 1, idle=False)


def interferer_gone_at_the_end() -> Case:
    """Two POLLs meet, and at the end of the first the other's transmitter is gone."""
    joins = (Join(0, 0, 1, 1, DUE), Join(0, 2, 3, 1, DUE))
    gone = tuple((-inf,) * 4 if source == 2 else row for source, row in enumerate(equal_powers(4)))
    powers = ((0, equal_powers(4)), (POLL + 126 * US, gone))
    return Case(Scene(bodies(0, 0, 1 * US, 1 * US), Radio(powers), joins, 40 * SLOT), 1, idle=False)


def jammer_gone_at_the_end() -> Case:
    """A jammer fills the band, and at the end of a POLL nobody receives it any more."""
    jammer = Jammer("constant", 0, 1_000_000_000, tuple(range(79)))
    powers = ((0, equal_powers(2, 1)), (POLL + 126 * US, (*equal_powers(2), (-inf, -inf))))
    scene = Scene(bodies(0, 0), Radio(powers, jammers=(jammer,)), (Join(0, 0, 1, 1, DUE),), 40 * SLOT)
    return Case(scene, 1, idle=False)


def page_in_calm_air() -> Case:
    """A page's POLLs meet the packets of the only piconet, for longer than its IDs are remembered."""
    inputs: list[Input] = [Join(0, 0, 1, 1, DUE)]
    inputs += [Send(1_000, 0, -1, 27, token) for token in range(90)]
    inputs.append(PageFor(6_000_000, 2, 3, 0))
    return Case(
        Scene(bodies(0, 0, 100 * US, 0), Radio(((0, equal_powers(4)),)), tuple(inputs), 180 * SLOT), 1, idle=False
    )


def touching_polls(later: int) -> Case:
    """One POLL ends as the other begins, on the same channel."""
    joins = (Join(0, 0, 1, 1, DUE), Join(0, 2, 3, 1, DUE))
    scene = Scene(bodies(0, 0, later, later), Radio(((0, equal_powers(4)),)), joins, 40 * SLOT)
    return Case(scene, 1, idle=False)


def loud_jammer_two_channels_away() -> Case:
    """A jammer, 1 dB less than what destroys a POLL from 2 MHz away."""
    channel = basic_channel(WORD, DUE)
    jammer = Jammer("constant", 0, 1_000_000_000, (channel + 2 if channel < 77 else channel - 2,))
    powers = (*equal_powers(2), (29.0, 29.0))
    radio = Radio(((0, powers),), mode="neighbouring", jammers=(jammer,))
    return Case(Scene(bodies(0, 0), radio, (Join(0, 0, 1, 1, DUE),), 40 * SLOT), 1, idle=False)


def master_that_does_not_hear() -> Case:
    """A piconet that is alone, in which nothing of the slave arrives."""
    powers = ((-inf, 0.0), (-inf, -inf))
    scene = Scene(bodies(0, 0), Radio(((0, powers),)), (Join(0, 0, 1, 1, DUE),), 80 * SLOT, supervision=40_000_000)
    return Case(scene, 1, idle=False)


def page_in_the_midst_of_a_pair() -> Case:
    """A slave is told to page, nobody answering, while it receives a long packet."""
    inputs = (Join(0, 0, 1, 1, DUE + 80), Send(POLL - 1, 0, 1, 339, 0), PageFor(POLL + 1_000, 1, 2, 0))
    powers = ((-inf, 0.0, -inf), (0.0, -inf, -inf), (-inf, -inf, -inf))
    return Case(Scene(bodies(0, 0, 0), Radio(((0, powers),)), inputs, 80 * SLOT, page_timeout=40), 1, idle=False)


def leaves_in_the_midst_of_a_poll() -> Case:
    """A slave gets a link in another piconet, where it is from then on, while an idle POLL of its first one arrives."""
    joins = (Join(0, 0, 1, 1, DUE), Join(0, 2, 3, 1, DUE), Join(POLL + 1_000, 2, 1, 2, DUE + 40))
    scene = Scene(bodies(0, 0, 60 * US, 60 * US), Radio(((0, equal_powers(4)),), mode="none"), joins, 60 * SLOT)
    return Case(scene, 1, idle=False)


def full_of_an_earlier_link(turned: bool = False) -> Case:
    """A link is lost and comes up again, perhaps *turned* round, while its slave's host is busy with the first one."""
    gone = ((-inf,) * 2,) * 2
    radio = Radio(((0, equal_powers(2)), (20_000_000, gone), (60_000_000, equal_powers(2))))
    again = Join(61_000_000, 1, 0, 1, FIRST + 224) if turned else Join(61_000_000, 0, 1, 1, FIRST + 224)
    inputs = (Join(0, 0, 1, 1, DUE), Send(1_000, 0, 1, 27, 0), again, Send(85_000_000, 0, 1, 27, 1))
    scene = Scene(bodies(0, 0), radio, inputs, 400 * SLOT, t_poll=16, supervision=30 * SLOT, host_bps=1080, room=1)
    return Case(scene, 1, idle=False)


def place_of_the_slave(length: int, bps: int) -> Case:
    """A slave's only place is free as it hears the next POLL, or 1 ns later; transports of 8 ms, or 7.968001 ms."""
    return _one_place(0, 1, length, bps)


def place_of_the_master(length: int, bps: int) -> Case:
    """A master's only place is free as it polls again, or 1 ns later; transports of 6.537 ms, or 6.817001 ms."""
    return _one_place(1, 0, length, bps)


def _one_place(source: int, destination: int, length: int, bps: int) -> Case:
    sends = tuple(Send(1_000, source, destination, length, token) for token in (0, 1))
    radio = Radio(((0, equal_powers(2)),))
    inputs = (Join(0, 0, 1, 1, DUE), *sends)
    scene = Scene(bodies(0, 0), radio, inputs, 80 * SLOT, t_poll=16, kinds=("DH5",), host_bps=bps, room=1)
    return Case(scene, 1, idle=False)


def equal_replies() -> Case:
    """Two devices answer an inquiry at once, without interference; one is enough."""
    radio = Radio(((0, equal_powers(3)),), mode="none")
    return Case(Scene(bodies(0, 0, 0), radio, (Inquire(0, 0, 400, 1),), 220 * SLOT), 1, idle=False)
