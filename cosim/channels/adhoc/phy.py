"""The physical layers of 802.11 that ad hoc radios use: their times, their rates, how long a frame is on the air.

    frequency hopping    clause 14                        1 Mb/s
    direct sequence      clauses 15 and 18 (802.11b)      1, 2, 5.5, 11 Mb/s
    OFDM at 5 GHz        clause 17 (802.11a)              6 to 54 Mb/s
    OFDM at 2.4 GHz      clause 19 (802.11g, ERP-OFDM)    6 to 54 Mb/s

Clauses are those of IEEE 802.11-2007. Its tables of times and windows stand in 14.9 (FH PHY characteristics), 15.3.3
(DS), 18.3.4 (High Rate), 17.4.4 (OFDM) and 19.8.4 (ERP). Where they give a bound, as "< 4 us", the bound is taken.

A frame on the air is a preamble and a header of the PHY (together: PLCP), and the octets of the MAC, its check sequence
included. Direct sequence: the octets take a whole number of microseconds, rounded up, which the header counts
(18.2.3.5, 18.3.4). OFDM: 16 service bits, the octets and 6 tail bits fill symbols of 4 us (17.3.5.3, 17.4.3); at
2.4 GHz 6 us of silence follow, which belong to the frame (19.8.3): they give decoders the time that the longer SIFS
gives them at 5 GHz. Frequency hopping: a bit lasts 1 us; the bit more in 33 against long runs (14.3.2.3) is left out,
as in Bianchi's table.

Data rates are whole numbers of kb/s. A network of 802.11g and 802.11b together is not modelled: ERP has its OFDM rates.
"""

from typing import Final, NamedTuple

import cosim.elementary as elementary
from cosim.units import US, Time

DATA_HEADER_OCTETS: Final = 24
"""Frame control, duration, three addresses, sequence control: a data frame within an ad hoc network (7.2.2)."""
FCS_OCTETS: Final = 4
"""The frame check sequence at the end of every frame (7.1.3.6)."""
LLC_OCTETS: Final = 8
"""LLC and SNAP headers before a packet of a network protocol (RFC 1042)."""
DATA_OVERHEAD_OCTETS: Final = DATA_HEADER_OCTETS + FCS_OCTETS + LLC_OCTETS
"""What a data frame has beyond the packet of the network protocol that it carries."""
RTS_OCTETS: Final = 20
"""A request to send with its check sequence (7.2.1.1)."""
CTS_OCTETS: Final = 14
"""A clear to send with its check sequence (7.2.1.2)."""
ACK_OCTETS: Final = 14
"""An acknowledgement with its check sequence (7.2.1.3)."""

_SERVICE_BITS: Final = 16
_TAIL_BITS: Final = 6
_SYMBOL: Final[Time] = 4 * US


class Plcp(NamedTuple):
    """The bits that the PHY puts before the octets of a frame: a preamble to synchronise on, and a header."""

    time: Time
    """Duration of both, ns."""
    header_bits: int
    """Bits of the header, all of which must be right; those of the preamble only help to find it."""
    header_kbps: int
    """The rate, hence the modulation, of the header."""


LONG: Final = Plcp(192 * US, 48, 1000)
"""144 bits and a header of 48, all at 1 Mb/s (15.2.2, 18.2.2.1)."""
SHORT: Final = Plcp(96 * US, 48, 2000)
"""72 bits at 1 Mb/s and a header of 48 at 2 Mb/s (18.2.2.2)."""
OFDM: Final = Plcp(20 * US, 24, 6000)
"""16 us of training symbols and a symbol of 24 bits, SIGNAL (17.3.2.3, 17.3.4)."""
HOPPING: Final = Plcp(128 * US, 32, 1000)
"""96 bits and a header of 32 (14.3.2)."""


class Phy(NamedTuple):
    """One physical layer; a network may replace its basic rates and windows."""

    name: str
    slot: Time
    """Slot of a back-off, ns."""
    sifs: Time
    """Time between a frame and its answer, ns."""
    cca: Time
    """Time after which a station senses energy on the air, ns."""
    cw_min: int
    """First contention window: a back-off is a number of slots from 0 to this."""
    cw_max: int
    """Greatest contention window."""
    plcp: Plcp
    rates_kbps: tuple[int, ...]
    """Rates for data, rising."""
    mandatory_kbps: tuple[int, ...]
    """Rates that every station has."""
    basic_kbps: tuple[int, ...]
    """The network's basic rate set, for answers and broadcasts."""
    bandwidth_hz: float
    """Bandwidth of the receiver, for its noise."""
    ofdm: bool = False
    extension: Time = 0
    """Silence at the end that counts as part of the frame, ns."""

    @property
    def difs(self) -> Time:
        """The space before a back-off or a frame in ns, SIFS and two slots (9.2.10)."""
        return self.sifs + 2 * self.slot

    @property
    def lowest_kbps(self) -> int:
        """The lowest basic rate, of broadcasts."""
        return min(self.basic_kbps)


_DSSS_KBPS: Final = (1000, 2000, 5500, 11000)
_OFDM_KBPS: Final = (6000, 9000, 12000, 18000, 24000, 36000, 48000, 54000)
_OFDM_MANDATORY_KBPS: Final = (6000, 12000, 24000)

FHSS: Final = Phy(
    name="fhss",
    slot=50 * US,
    sifs=28 * US,
    cca=27 * US,
    cw_min=15,
    cw_max=1023,
    plcp=HOPPING,
    rates_kbps=(1000,),
    mandatory_kbps=(1000,),
    basic_kbps=(1000,),
    bandwidth_hz=1e6,
)
"""Frequency hopping at 1 Mb/s: the PHY of Bianchi's figures (JSAC 18(3), 2000, Table II), who varies the windows."""
DSSS: Final = Phy(
    name="dsss",
    slot=20 * US,
    sifs=10 * US,
    cca=15 * US,
    cw_min=31,
    cw_max=1023,
    plcp=LONG,
    rates_kbps=_DSSS_KBPS,
    mandatory_kbps=_DSSS_KBPS,
    basic_kbps=(1000, 2000),
    bandwidth_hz=22e6,
)
"""802.11b with long preambles; the basic rates are those that stations of 1999 understand, too."""
DSSS_SHORT: Final = DSSS._replace(name="dsss_short", plcp=SHORT)
"""802.11b with short preambles, except for frames at 1 Mb/s, for which there are none (18.2.2.2)."""
OFDM_5GHZ: Final = Phy(
    name="ofdm",
    slot=9 * US,
    sifs=16 * US,
    cca=4 * US,
    cw_min=15,
    cw_max=1023,
    plcp=OFDM,
    rates_kbps=_OFDM_KBPS,
    mandatory_kbps=_OFDM_MANDATORY_KBPS,
    basic_kbps=_OFDM_MANDATORY_KBPS,
    bandwidth_hz=20e6,
    ofdm=True,
)
"""802.11a, channels of 20 MHz."""
ERP: Final = OFDM_5GHZ._replace(name="erp", sifs=10 * US, extension=6 * US)
"""802.11g among its like: short slots."""
ERP_LONG_SLOT: Final = ERP._replace(name="erp_long_slot", slot=20 * US, cca=15 * US)
"""802.11g with the slots of 802.11b: so the standard wants it in an ad hoc network (7.3.1.4, IBSS)."""

PROFILES: Final[dict[str, Phy]] = {phy.name: phy for phy in (FHSS, DSSS, DSSS_SHORT, OFDM_5GHZ, ERP, ERP_LONG_SLOT)}
"""All physical layers, by name."""


NOISE_FIGURE_DB: Final = 7.0
"""Noise figure of a usual receiver, as in ns-3."""
_NOISE_DBM_PER_HZ: Final = -173.9751871942281
"""Thermal noise at 290 K."""


def noise_dbm(bandwidth_hz: float, noise_figure_db: float = NOISE_FIGURE_DB) -> float:
    """Return the noise of a receiver in dBm."""
    return _NOISE_DBM_PER_HZ + 10.0 * elementary.log10(bandwidth_hz) + noise_figure_db


def plcp_of(phy: Phy, rate_kbps: int) -> Plcp:
    """Return the preamble and header of a frame at *rate_kbps*."""
    return LONG if rate_kbps == 1000 and phy.plcp == SHORT else phy.plcp


def airtime(phy: Phy, rate_kbps: int, octets: int) -> Time:
    """Return how long a frame of *octets*, check sequence included, is on the air at *rate_kbps*, in ns.

    Raise ValueError if the PHY has no such rate.
    """
    if rate_kbps not in phy.rates_kbps:
        rates = ", ".join(f"{rate / 1000:g}" for rate in phy.rates_kbps)
        raise ValueError(f"{phy.name} has no rate of {rate_kbps / 1000:g} Mb/s, but {rates}")
    if phy.ofdm:
        symbol_bits = rate_kbps * _SYMBOL // 1_000_000
        symbols = -(-(_SERVICE_BITS + 8 * octets + _TAIL_BITS) // symbol_bits)
        return phy.plcp.time + symbols * _SYMBOL + phy.extension
    return plcp_of(phy, rate_kbps).time + -(-8000 * octets // rate_kbps) * US


def control_kbps(phy: Phy, rate_kbps: int) -> int:
    """Return the rate of the ACK or CTS that answers a frame at *rate_kbps*.

    The highest basic rate that is not above it; if there is none, the highest mandatory one (9.6).
    """
    basic = [rate for rate in phy.basic_kbps if rate <= rate_kbps]
    return max(basic or [rate for rate in phy.mandatory_kbps if rate <= rate_kbps])


def eifs(phy: Phy) -> Time:
    """Return the space in ns that takes the place of DIFS after a frame with errors: room for an ACK (9.2.10)."""
    return phy.sifs + airtime(phy, phy.lowest_kbps, ACK_OCTETS) + phy.difs


def answer_timeout(phy: Phy, answer_kbps: int, propagation: Time) -> Time:
    """Return for how many ns after its frame a station waits until an answer at *answer_kbps* has begun.

    SIFS, a slot, and the time until the PHY has the header of the answer (9.2.5.7, 9.2.8), for which the PLCP's is
    taken; and the *propagation* to and fro, ns, which the standard counts as part of the slot.
    """
    return phy.sifs + phy.slot + plcp_of(phy, answer_kbps).time + 2 * propagation


class Section(NamedTuple):
    """Part of a frame in which all bits have the same modulation."""

    begin: Time
    """Time since the frame began, ns."""
    end: Time
    rate_kbps: int
    """Rate of its bits, hence their modulation."""
    bits: int
    """Number of bits that must be right, spread evenly over the time."""


def sections(phy: Phy, rate_kbps: int, octets: int) -> tuple[Section, Section]:
    """Return header and payload of a frame of *octets* at *rate_kbps*; ValueError if the PHY has no such rate.

    What comes before the header, and an extension, may be hit without harm.
    """
    plcp = plcp_of(phy, rate_kbps)
    end = airtime(phy, rate_kbps, octets) - phy.extension
    begin = plcp.time - plcp.header_bits * 1_000_000 // plcp.header_kbps
    return (
        Section(begin, plcp.time, plcp.header_kbps, plcp.header_bits),
        Section(plcp.time, end, rate_kbps, 8 * octets),
    )
