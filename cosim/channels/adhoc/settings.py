"""Parameters of an 802.11 ad hoc network in a scenario."""

import math
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

import cosim.elementary as elementary
from cosim.channels.adhoc.mac import Access, Form, Limits, Timing
from cosim.channels.adhoc.phy import (
    ACK_OCTETS,
    CTS_OCTETS,
    NOISE_FIGURE_DB,
    PROFILES,
    RTS_OCTETS,
    Phy,
    airtime,
    answer_timeout,
    control_kbps,
    eifs,
    noise_dbm,
    sections,
)
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.flooding import FloodingSettings
from cosim.channels.adhoc.routing.olsr import OlsrSettings
from cosim.channels.kinds import ChannelSettings
from cosim.channels.propagation import PropagationSettings
from cosim.settings import Count, Decibels, Gain, Metres, Rate, Seconds, error_at
from cosim.units import US, from_seconds

UNJAMMED: Final = {"ofdm": "it works at 5 GHz", "fhss": "its hopping is not modelled"}
"""Physical layers that nothing at 2.4 GHz disturbs, and why."""
PhyName = Literal["dsss", "dsss_short", "erp", "erp_long_slot", "ofdm", "fhss"]


RoutingSettings: TypeAlias = Annotated[FloodingSettings | AodvSettings | OlsrSettings, Field(discriminator="kind")]


class AdhocSettings(ChannelSettings):
    """An 802.11 ad hoc network to the slot: the distributed coordination function, with routing if it is asked for."""

    kind: Literal["adhoc"] = "adhoc"
    range_m: Metres | None = Field(
        default=None,
        gt=0,
        description="m, reach of a radio without propagation, unless the team says otherwise; unlimited if not given",
    )
    propagation: PropagationSettings | None = Field(
        default=None, description="how signals fade; without it all frames in range_m are alike, and any two collide"
    )
    power_dbm: Decibels = Field(default=15.0, description="dBm, transmit power, unless the team says otherwise")
    noise_figure_db: Decibels = Field(default=NOISE_FIGURE_DB, ge=0, description="dB, of the receivers")
    detection_dbm: Decibels = Field(default=-82.0, description="dBm, weaker frames are not noticed as frames")
    energy_dbm: Decibels = Field(default=-62.0, description="dBm, from which on energy makes the medium busy")
    capture_db: Decibels | None = Field(
        default=5.0,
        ge=0,
        description="dB by which a frame must be stronger to take over from one in its preamble; null: none does",
    )
    neglect_db: Decibels | None = Field(
        default=None,
        ge=0,
        description="dB below a receiver's noise, from which on it is spared signals, as interference too: k of them "
        "at once would lower a signal-to-noise ratio by less than 10 lg(1 + k 10^(-neglect_db / 10)) dB; "
        "null: spared only what is below -140 dBm",
    )
    phy: PhyName = Field(
        default="dsss", description="802.11b (dsss, or with short preambles), 802.11g (erp), 802.11a (ofdm), or hopping"
    )
    channel: int = Field(
        default=1, ge=1, le=13, description="in the band of 2.4 GHz, 5 MHz apart: which jammers disturb it"
    )
    rate_mbps: Rate | None = Field(
        default=None, gt=0, description="Mb/s of payloads to one robot; the lowest of the PHY if not given"
    )
    basic_rates_mbps: tuple[Gain, ...] | None = Field(
        default=None, min_length=1, description="Mb/s, of broadcasts (the lowest) and answers; the PHY's if not given"
    )
    overhead_octets: Count = Field(
        default=36, ge=28, description="octets of a frame beyond the payload: MAC header and FCS 28, LLC and SNAP 8"
    )
    cw_min: Count | None = Field(
        default=None, ge=0, description="slots, the first contention window; the PHY's if not given"
    )
    cw_max: Count | None = Field(default=None, ge=0, description="slots, the greatest one; the PHY's if not given")
    rts_threshold: Count | None = Field(
        default=None, ge=0, description="octets, longer payloads are preceded by RTS and CTS; none if not given"
    )
    short_retries: Count | None = Field(
        default=7, ge=1, description="times that an RTS, or a frame without, is sent; null: until it gets an answer"
    )
    long_retries: Count | None = Field(default=4, ge=1, description="times that a frame after an RTS is sent")
    queue_payloads: Count | None = Field(
        default=None, ge=1, description="payloads that a device holds; unlimited if not given"
    )
    routing: RoutingSettings | None = Field(
        default=None,
        description="how payloads get beyond a radio's reach, over other robots; not at all if not given",
    )
    host_jitter_s: Seconds = Field(
        default=0.0,
        ge=0,
        description="s, at most, that a payload takes from host to radio, at random; hosts may act at one instant",
    )
    energy: Literal["states"] | None = Field(
        default=None, description="what radios use is counted: their times by state (states)"
    )
    propagation_s: Seconds = Field(default=1e-6, gt=0, description="s from a sender to a receiver, wherever they are")
    bianchi_counting: bool = Field(
        default=False, description="whether a busy period takes a slot from every back-off, as in Bianchi's model"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        rates = [rate / 1000 for rate in self.radio.rates_kbps]
        for field, wanted in (("rate_mbps", (self.rate_mbps,)), ("basic_rates_mbps", self.basic_rates_mbps or ())):
            for rate in wanted:
                if rate is not None and rate not in rates:
                    expected = f"is not one of {', '.join(f'{each:g}' for each in rates)}"
                    raise error_at((field,), rate, expected)
        if self.propagation is not None and self.phy == "fhss":
            raise error_at(("phy",), self.phy, "has no model of bit errors, which propagation needs")
        if self.neglect_db is not None and self.propagation is None:
            raise error_at(("neglect_db",), self.neglect_db, "is for signals that fade: there is no propagation")
        if self.neglect_db is not None and self.neglected_mw() >= mw(self.detection_dbm):
            raise error_at(("neglect_db",), self.neglect_db, "neglects signals above detection_dbm, expected more")
        if self.access.cw_max < self.access.cw_min:
            raise error_at(("cw_max",), self.access.cw_max, f"is not >= {self.access.cw_min}, cw_min")
        return self

    @property
    def radio(self) -> Phy:
        """The physical layer, with the basic rates of this network."""
        phy = PROFILES[self.phy]
        if self.basic_rates_mbps is None:
            return phy
        return phy._replace(basic_kbps=tuple(sorted(_kbps(rate) for rate in self.basic_rates_mbps)))

    @property
    def rate_kbps(self) -> int:
        """The rate of payloads to one robot."""
        return min(self.radio.rates_kbps) if self.rate_mbps is None else _kbps(self.rate_mbps)

    @property
    def access(self) -> Access:
        """The rules of access."""
        phy = PROFILES[self.phy]
        return Access(
            phy.cw_min if self.cw_min is None else self.cw_min,
            phy.cw_max if self.cw_max is None else self.cw_max,
            self.rts_threshold,
            self.short_retries,
            self.long_retries,
            self.bianchi_counting,
        )

    def timing(self) -> Timing:
        """Return all times of the network."""
        phy, rate, overhead = self.radio, self.rate_kbps, self.overhead_octets
        delay = max(1, from_seconds(self.propagation_s))
        answers = control_kbps(phy, rate)
        timeout = phy.sifs + 2 * delay + US if self.bianchi_counting else answer_timeout(phy, answers, delay)
        return Timing(
            slot=phy.slot,
            sifs=phy.sifs,
            difs=phy.difs,
            eifs=phy.difs if self.bianchi_counting else eifs(phy),
            cca=phy.cca,
            delay=delay,
            timeout=timeout,
            ack=form(phy, answers, ACK_OCTETS),
            rts=form(phy, answers, RTS_OCTETS),
            cts=form(phy, answers, CTS_OCTETS),
            unicast=lambda octets: form(phy, rate, octets + overhead),
            broadcast=lambda octets: form(phy, phy.lowest_kbps, octets + overhead),
        )

    def limits(self) -> Limits:
        """Return the thresholds of receivers, if signals fade."""
        capture = math.inf if self.capture_db is None else mw(self.capture_db)
        return Limits(mw(self._noise_dbm), mw(self.detection_dbm), mw(self.energy_dbm), capture)

    def neglected_mw(self) -> float:
        """Return the power in mW up to which signals are neglected, if they fade; 0 if ``neglect_db`` says nothing."""
        return 0.0 if self.neglect_db is None else mw(self._noise_dbm - self.neglect_db)

    @property
    def _noise_dbm(self) -> float:
        return noise_dbm(self.radio.bandwidth_hz, self.noise_figure_db)


def form(phy: Phy, rate_kbps: int, octets: int) -> Form:
    """Return how a frame of *octets* is sent at *rate_kbps*."""
    header, rest = sections(phy, rate_kbps, octets)
    duration = airtime(phy, rate_kbps, octets)
    return Form(duration, octets, rate_kbps, rest.begin, header.begin, header.rate_kbps, header.bits, rest.end)


def mw(dbm: float) -> float:
    """Return mW for dBm, or a ratio for dB."""
    return elementary.exp10(dbm / 10.0)


def _kbps(rate_mbps: float) -> int:
    return round(1000 * rate_mbps)
