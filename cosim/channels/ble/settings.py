"""Parameters of the Bluetooth Low Energy channel in a scenario."""

from typing import Final, Literal, Self

from pydantic import Field, model_validator

from cosim.channels.ble.advertising import LONGEST_DELAY
from cosim.channels.ble.bits.l2cap import LEAST_OCTETS
from cosim.channels.ble.bits.pdu import CLOCK_ACCURACIES_PPM
from cosim.channels.ble.connections.exchange import exchange_time
from cosim.channels.ble.connections.parameters import ConnectionParameters
from cosim.channels.ble.phy import CODED_S8, LE_1M, LE_2M, Phy
from cosim.channels.kinds import ChannelSettings
from cosim.channels.propagation import PropagationSettings
from cosim.errors import UserError
from cosim.settings import Count, Decibels, Metres, Seconds, Settings, error_at
from cosim.units import MS, US, Time, from_seconds

UNIT: Final[Time] = 625 * US
"""Unit of advertising and scan intervals and of scan windows."""
PhyName = Literal["1M", "2M", "coded"]
Interference = Literal["none", "band"]
Part = Literal["states", "nrf52840"]
By = Literal["extended", "legacy", "mesh"]
MESH_UNIT: Final[Time] = 10 * MS
"""Unit of the intervals at which nodes of a mesh send a PDU again (Mesh Profile 1.0, 4.2.19.2 and 4.2.20.2)."""

LINK_PHYS: Final[dict[str, Phy]] = {"1M": LE_1M, "2M": LE_2M, "coded": CODED_S8}
"""PHYs to which links can change, by their names."""
LEAST_PART: Final[Time] = 1_250 * US
"""Least part of an interval that a link has on any PHY."""
MOST_LINKS: Final = 8
"""Links that a central holds at most if a scenario does not say how many."""


def _in_units(settings: Settings, name: str, low_ms: float, high_ms: float) -> Time:
    """Return the setting *name*, s, in ns; raise a ValidationError unless it is a multiple of the unit in bounds."""
    time = from_seconds(getattr(settings, name))
    if time % UNIT or not low_ms * MS <= time <= high_ms * MS:
        bounds = f"from {low_ms:g} to {high_ms:g} ms"
        raise error_at((name,), time / MS, f"ms is not a multiple of {UNIT / MS} ms {bounds}")
    return time


class ScanSettings(Settings):
    """When a device listens to advertising: a window at the beginning of each interval."""

    interval_s: Seconds = Field(default=0.03, gt=0, description="s, scanInterval: the channel changes after each")
    window_s: Seconds = Field(default=0.03, gt=0, description="s, scanWindow; as long as the interval: without a pause")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        interval = _in_units(self, "interval_s", 2.5, 10_240)
        if _in_units(self, "window_s", 2.5, 10_240) > interval:
            raise error_at(("window_s",), self.window_s, f"is not <= {self.interval_s}, interval_s")
        return self

    @property
    def interval(self) -> Time:
        """The scanInterval in ns."""
        return from_seconds(self.interval_s)

    @property
    def window(self) -> Time:
        """The scanWindow in ns."""
        return from_seconds(self.window_s)


class SearchSettings(ScanSettings):
    """How a device looks for others, and connects."""

    active: bool = Field(
        default=False,
        description="whether who inquires asks for names, which are in scan responses then; else advertisements say "
        "them",
    )


class AdvertiseSettings(Settings):
    """How a device lets itself be found and connected: connectable undirected advertising."""

    interval_s: Seconds = Field(
        default=0.1, gt=0, description="s, advInterval; up to 10 ms are added to each at random"
    )

    @model_validator(mode="after")
    def _sound(self) -> Self:
        _in_units(self, "interval_s", 20, 10_240)
        return self

    @property
    def interval(self) -> Time:
        """The advInterval in ns."""
        return from_seconds(self.interval_s)


class MeshSettings(Settings):
    """How nodes of Bluetooth Mesh flood; the defaults are Zephyr's (subsys/bluetooth/mesh/Kconfig, 007eaf2d)."""

    ttl: Count = Field(
        default=7, le=127, description="hops that a payload makes at most; 0 for one that nobody is to repeat, never 1"
    )
    network_transmits: Count = Field(default=3, ge=1, le=8, description="times that a node sends each PDU of its own")
    network_interval_s: Seconds = Field(
        default=0.02, gt=0, description="s from one of them to the next; up to 10 ms are added to each at random"
    )
    relay: bool = Field(default=True, description="whether nodes repeat what others send")
    relay_transmits: Count = Field(default=3, ge=1, le=8, description="times that a node sends each PDU of others")
    relay_interval_s: Seconds = Field(default=0.02, gt=0, description="s from one of them to the next, likewise")
    relay_buffers: Count = Field(
        default=32, ge=1, description="PDUs of others that a node holds; it does not repeat what comes beyond them"
    )
    cache: Count = Field(default=32, ge=2, description="PDUs that a node remembers, so as not to take them twice")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.ttl == 1:
            raise error_at(("ttl",), 1, "is not 0, or from 2 to 127")
        for name in ("network_interval_s", "relay_interval_s"):
            time = from_seconds(getattr(self, name))
            if time % MESH_UNIT or not MESH_UNIT <= time <= 32 * MESH_UNIT:
                raise error_at((name,), time / MS, "ms is not a multiple of 10 ms from 10 to 320 ms")
        return self

    def transmits(self, relayed: bool) -> tuple[int, Time]:
        """Return how often a PDU is sent, and the time, ns, from one time to the next: another's, or an own one."""
        if relayed:
            return self.relay_transmits, from_seconds(self.relay_interval_s)
        return self.network_transmits, from_seconds(self.network_interval_s)


class BroadcastSettings(AdvertiseSettings):
    """How payloads for everyone are sent: as an advertising set each, extended or legacy, or by flooding."""

    by: By = Field(
        default="extended",
        description="extended advertising, 1622 bytes at most; legacy advertising, 27; or Bluetooth Mesh, 377",
    )
    events: Count = Field(
        default=3, ge=1, le=255, description="advertising events in which a payload is sent; not of mesh"
    )
    interval_s: Seconds = Field(
        default=0.02, gt=0, description="s from one of them to the next, as of advertising; not of mesh"
    )
    phy: PhyName = Field(
        default="1M", description="PHY of the packets that carry the payload; other than 1M only if extended"
    )
    mesh: MeshSettings = Field(default_factory=MeshSettings, description="how nodes flood, by mesh")

    @model_validator(mode="after")
    def _has_phy(self) -> Self:
        if self.by != "extended" and self.phy != "1M":
            raise error_at(("phy",), self.phy, f"is not 1M, as of all advertising by {self.by}")
        return self

    @model_validator(mode="after")
    def _speaks_of_its_own(self) -> Self:
        """Refuse what a mesh has words of its own for."""
        for name in ("events", "interval_s") if self.by == "mesh" else ():
            if (value := getattr(self, name)) != type(self).model_fields[name].default:
                raise error_at((name,), value, "is not for mesh, which has network_transmits and network_interval_s")
        return self


class ConnectionSettings(Settings):
    """The links of a central, all alike."""

    interval_s: Seconds = Field(default=0.03, gt=0, description="s from one event of a link to the next: connInterval")
    latency: Count = Field(
        default=0, description="events in a row that a peripheral with nothing to send may leave out"
    )
    supervision_s: Seconds = Field(default=4.0, gt=0, description="s without a packet until a link is taken for lost")
    links: Count | None = Field(
        default=None,
        ge=1,
        description="links that a central holds at most, each with its part of the interval; 8, or as many as fit, if "
        "not given",
    )
    phy: PhyName = Field(default="1M", description="PHY to which links change as they come up")
    octets: Count = Field(default=251, ge=27, le=251, description="longest payload of a packet, agreed on after 27")
    mtu_octets: Count = Field(
        default=65_535, ge=23, le=65_535, description="longest ATT PDU; devices as sold have 23 to 517"
    )
    afh: bool = Field(default=False, description="whether centrals leave out bad channels; not with a latency")
    afh_interval_s: Seconds = Field(default=1.0, gt=0, description="s from one choice of channels to the next")
    afh_retry_s: Seconds = Field(default=30.0, gt=0, description="s until a bad channel is tried again")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        try:
            interval = self.parameters.interval
        except UserError as error:
            raise error_at((), self, str(error)) from None
        most = interval // self.least_part
        if not most:
            raise error_at(("interval_s",), self.interval_s, f"s is too short for a link on {self.phy}")
        if self.links is not None and self.links > most:
            raise error_at(("links",), self.links, f"links do not fit into {interval / MS:g} ms, at most {most} do")
        if self.afh and self.latency:
            raise error_at(("afh",), True, "is not for links with a latency: who sleeps is taken for who is not heard")
        return self

    @property
    def interval(self) -> Time:
        """The connInterval in ns."""
        return from_seconds(self.interval_s)

    @property
    def least_part(self) -> Time:
        """The least part of an interval that a link has, ns: the shortest packets, one each way, on either PHY."""
        phys = LE_1M, LINK_PHYS[self.phy]
        return max(LEAST_PART, *(exchange_time(phy, LEAST_OCTETS, phy, LEAST_OCTETS) + 2 * US for phy in phys))

    @property
    def parts(self) -> int:
        """The number of parts of an interval, and thus of the links that a central holds at most."""
        return self.links or min(MOST_LINKS, self.interval // self.least_part)

    @property
    def adaptation(self) -> tuple[Time, Time] | None:
        """Time from one choice of channels to the next, and until a bad one is tried again; None: no map is chosen."""
        return (from_seconds(self.afh_interval_s), from_seconds(self.afh_retry_s)) if self.afh else None

    @property
    def parameters(self) -> ConnectionParameters:
        """The parameters of each link; UserError for what the specification does not allow."""
        return ConnectionParameters(from_seconds(self.interval_s), self.latency, from_seconds(self.supervision_s))


class BleSettings(ChannelSettings):
    """Bluetooth Low Energy to the packet: advertising, scanning, initiating, and connections of several links."""

    kind: Literal["ble"] = "ble"
    range_m: Metres | None = Field(
        default=None, gt=0, description="m, reach of a radio without a law of propagation; unlimited if not given"
    )
    propagation: PropagationSettings | None = Field(
        default=None, description="how signals fade; without it everything within range_m is received without errors"
    )
    power_dbm: Decibels = Field(default=0.0, description="dBm, transmit power, unless the team says otherwise")
    sensitivity_dbm: Decibels = Field(
        default=-99.0,
        description="dBm, power at a bit error rate of 1e-3 on LE 1M; 2M has 3 dB more, coded 9.5 dB less",
    )
    interference: Interference = Field(
        default="band", description="whether what overlaps in time and frequency disturbs: nothing, or all in the band"
    )
    advertise: AdvertiseSettings = Field(
        default_factory=AdvertiseSettings, description="how devices let themselves be found"
    )
    scan: SearchSettings = Field(default_factory=SearchSettings, description="how devices look for others, and connect")
    listen: ScanSettings = Field(
        default_factory=ScanSettings,
        description="when devices listen to payloads for everyone; what else they do goes first",
    )
    broadcast: BroadcastSettings = Field(
        default_factory=BroadcastSettings, description="how payloads for everyone are sent"
    )
    connection: ConnectionSettings = Field(default_factory=ConnectionSettings, description="how links are")
    page_s: Seconds = Field(
        default=5.12, gt=0, description="s until a device that cannot be connected is given up, as in Bluetooth"
    )
    queue_payloads: Count | None = Field(
        default=None,
        ge=1,
        description="payloads that a device holds for a link, or for everyone; unlimited if not given",
    )
    clock_ppm: int = Field(default=20, ge=0, le=500, description="ppm, greatest error of the devices' clocks")
    energy: Part | None = Field(
        default=None,
        description="what radios use is counted: their times by state (states), and the energy of a part (nrf52840)",
    )
    idle_frames: bool = Field(
        default=False, description="whether recorded frames include links' polls and empty answers"
    )

    @property
    def sca(self) -> int:
        """The code of the clocks' accuracy."""
        return max(code for code, ppm in enumerate(CLOCK_ACCURACIES_PPM) if ppm >= self.clock_ppm)


assert LONGEST_DELAY < 20 * MS  # events of one advertiser never meet
