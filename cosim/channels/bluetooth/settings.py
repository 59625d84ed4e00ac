"""Parameters of the Bluetooth channel in a scenario."""

from typing import Literal, Self

from pydantic import Field, model_validator

from cosim.channels.bluetooth.bits.powers import noise_dbm, thermal_noise_dbm
from cosim.channels.bluetooth.inquiry import InquiryScanSettings, InquirySettings
from cosim.channels.bluetooth.packets import ACL, AclName
from cosim.channels.bluetooth.paging import PageSettings
from cosim.channels.bluetooth.radio import Interference
from cosim.channels.bluetooth.scanning import ScanSettings
from cosim.channels.bluetooth.state import PiconetSettings, Scheduler
from cosim.channels.kinds import ChannelSettings
from cosim.channels.propagation import PropagationSettings
from cosim.settings import BitRate, Count, Decibels, Metres, Seconds, error_at
from cosim.units import from_seconds


class BluetoothSettings(ChannelSettings):
    """Bluetooth to the half-slot: inquiry, page, piconets and scatternets, polled by their masters."""

    kind: Literal["bluetooth"] = "bluetooth"
    range_m: Metres | None = Field(
        default=None, gt=0, description="m, reach of a radio without a law of propagation; unlimited if not given"
    )
    propagation: PropagationSettings | None = Field(
        default=None, description="how signals fade; without it everything within range_m is received without errors"
    )
    power_class: Literal[1, 2, 3] = Field(
        default=2, description="transmit power 20, 4 or 0 dBm, of robots that the team gives none of their own"
    )
    sensitivity_dbm: Decibels = Field(default=-80.0, description="dBm, received power at a bit error rate of 1e-3")
    noise_figure_db: Decibels | None = Field(
        default=None, ge=0, description="dB, of the receivers; if given, it stands in place of the sensitivity"
    )
    interference: Interference = Field(
        default="co_channel",
        description="which frames of others can destroy a frame: none, of its channel, or beside it too",
    )
    packet_types: tuple[AclName, ...] = Field(
        default=("DM1", "DH1", "DM3", "DH3", "DM5", "DH5"), min_length=1, description="packets that carry payloads"
    )
    n_bc: Count = Field(default=1, ge=1, description="how often a broadcast is sent")
    t_poll_slots: Count = Field(
        default=40, ge=16, multiple_of=2, description="slots of 625 us until an idle slave is polled again"
    )
    scheduler: Scheduler = Field(
        default="lazy", description="slaves that a master addresses: those due or with a payload, or one in every slot"
    )
    packet_choice: Literal["smallest", "best"] = Field(
        default="smallest", description="packet type of a payload: the smallest, or the best at the link's Es/N0"
    )
    queue_payloads: Count | None = Field(
        default=None, ge=1, description="payloads that a device holds for a piconet; unlimited if not given"
    )
    host_bps: BitRate | None = Field(
        default=None, gt=0, description="bit/s at which a device hands payloads to its host; at once if not given"
    )
    receive_payloads: Count = Field(
        default=8, ge=1, description="payloads of one sender that a device holds until its host has them (FLOW)"
    )
    flush_s: Seconds | None = Field(
        default=None, gt=0, description="s until a payload without acknowledgement is dropped; never if not given"
    )
    park_interval_slots: Count = Field(
        default=2048, ge=64, multiple_of=2, description="slots from a beacon for parked slaves to the next"
    )
    park_window_slots: Count = Field(
        default=64, ge=12, multiple_of=2, description="slots at a beacon in which parked slaves hear broadcasts"
    )
    channels: Literal[79, 23] = Field(default=79, description="79, or 23 as in v1.1 (statistically alike only)")
    afh: bool = Field(default=False, description="whether masters leave out bad channels")
    afh_interval_s: Seconds = Field(default=1.0, gt=0, description="s from one choice of channels to the next")
    afh_retry_s: Seconds = Field(default=30.0, gt=0, description="s until a bad channel is tried again")
    supervision_s: Seconds = Field(default=20.0, gt=0, description="s without a frame until a link is taken for lost")
    clock_ppm: int = Field(default=20, ge=0, le=250, description="ppm, greatest drift of native clocks")
    inquiry: InquirySettings = Field(default_factory=InquirySettings, description="how devices look for others")
    inquiry_scan: InquiryScanSettings = Field(
        default_factory=InquiryScanSettings, description="how devices let themselves be found"
    )
    page: PageSettings = Field(default_factory=PageSettings, description="how devices ask for a link")
    page_scan: ScanSettings = Field(default_factory=ScanSettings, description="how devices let themselves be paged")
    energy: Literal["states"] | None = Field(
        default=None, description="what radios use is counted: their times by state (states)"
    )
    idle_frames: bool = Field(default=False, description="whether recorded frames include idle POLL and NULL")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.afh and self.channels == 23:
            raise error_at(("afh",), True, "is not known to a system of 23 channels")
        if self.park_window_slots > self.park_interval_slots:
            raise error_at(
                ("park_window_slots",),
                self.park_window_slots,
                f"is not <= {self.park_interval_slots}, park_interval_slots",
            )
        return self

    @property
    def piconet(self) -> PiconetSettings:
        """The parameters of each piconet."""
        return PiconetSettings(
            types=tuple(ACL[name] for name in self.packet_types),
            n_bc=self.n_bc,
            t_poll_slots=self.t_poll_slots,
            supervision=from_seconds(self.supervision_s),
            scheduler=self.scheduler,
            queue=self.queue_payloads,
            flush=None if self.flush_s is None else from_seconds(self.flush_s),
            park_interval_slots=self.park_interval_slots,
            park_window_slots=self.park_window_slots,
            best_packets=self.packet_choice == "best",
            afh=(from_seconds(self.afh_interval_s), from_seconds(self.afh_retry_s)) if self.afh else None,
            idle_frames=self.idle_frames,
        )

    @property
    def noise_dbm(self) -> float:
        """The noise in dBm at a receiver; -inf without a law of propagation."""
        if self.propagation is None:
            return float("-inf")
        if self.noise_figure_db is not None:
            return thermal_noise_dbm(self.noise_figure_db)
        return noise_dbm(self.sensitivity_dbm)
