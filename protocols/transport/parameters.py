"""What a scenario can set of a transport, and of the links that it keeps."""

from typing import Self

from pydantic import Field, model_validator

from cosim.settings import Count, Period, Seconds, Settings, error_at
from protocols.transport.frames import LEAST_OCTETS, MOST_OCTETS, WINDOW


class PagingParameters(Settings):
    """How the master of a piconet pages robots to which it has no link, for radios that carry nothing without one."""

    patience_s: Seconds = Field(
        default=6.0,
        gt=0,
        description="s, the longest that a master waits for the end of a page; longer than any page lasts",
    )
    page_s: Seconds = Field(
        default=5.0, gt=0, description="s from a page in vain to the next one, of a robot that is likely to be near"
    )
    page_most_s: Seconds = Field(
        default=60.0,
        gt=0,
        description="s, the longest such wait for any other robot, which doubles with each page in vain",
    )

    @model_validator(mode="after")
    def _waits_grow(self) -> Self:
        if not self.page_s <= self.page_most_s:
            raise error_at(("page_s",), self.page_s, f"is not <= {self.page_most_s}, page_most_s")
        return self


class LinkParameters(PagingParameters):
    """How robots keep a piconet of all, for radios that need links; another robot becomes master if the first dies.

    A robot without a master takes over after ``alone_s``, and ``stagger_s`` more for each robot that is before it in
    the order of masters and may be alive.
    """

    first: Count = Field(
        default=0, ge=0, description="the first in the order of masters; the others follow by their addresses"
    )
    takeover: bool = Field(
        default=True, description="False: the first is the master for good, and if it dies there is none"
    )
    service: Count = Field(
        default=3,
        ge=0,
        description="least time for its slaves after a master has paged in vain, in multiples of that page's",
    )
    beat_s: Period = Field(default=2.0, gt=0, description="s without a publication until a robot sends a heartbeat")
    silence_s: Seconds | None = Field(
        default=15.0,
        gt=0,
        description="s without any frame until a link is given up; null: only when the radio reports its loss",
    )
    alone_s: Seconds = Field(default=10.0, gt=0, description="s without a master until the next in order takes over")
    stagger_s: Seconds = Field(
        default=10.0, gt=0, description="s more for each robot before it in the order that may be alive"
    )

    @model_validator(mode="after")
    def _beats_break_silence(self) -> Self:
        if self.silence_s is not None and not self.beat_s < self.silence_s:
            raise error_at(("silence_s",), self.silence_s, f"is not > {self.beat_s}, beat_s")
        return self


class TransportParameters(Settings):
    """How messages are carried and values published."""

    octets: int = Field(default=200, ge=LEAST_OCTETS, le=MOST_OCTETS, description="bytes, the longest frame")
    window: int = Field(default=16, ge=1, le=WINDOW, description="parts of messages to one robot on the way at a time")
    in_device: Count = Field(default=4, ge=1, description="frames to one neighbour in the own radio at a time")
    fate_s: Seconds = Field(default=3.0, gt=0, description="s until a radio has forgotten a frame")
    retry_s: Seconds = Field(default=1.0, gt=0, description="s until a part is sent again, before any answer")
    retry_least_s: Period = Field(default=0.2, gt=0, description="s, the shortest such time, once answers are timed")
    retry_most_s: Seconds = Field(
        default=4.0, gt=0, description="s, the longest such time; it doubles with each time in vain"
    )
    give_up_s: Seconds = Field(default=60.0, gt=0, description="s without any answer until a message is given up")
    ack_s: Seconds = Field(default=0.02, ge=0, description="s that an acknowledgement waits for more parts")
    spread_s: Seconds = Field(
        default=0.05,
        ge=0,
        description="s, the longest that a publication waits, each for a time of its own; 0 with links",
    )
    flood: bool = Field(
        default=False, description="True: each robot relays a publication once, for those out of its author's reach"
    )
    links: LinkParameters | None = Field(
        default=None, description="keep the links of a piconet, as Bluetooth needs; by default send to all in reach"
    )

    @model_validator(mode="after")
    def _waits_grow(self) -> Self:
        if not self.retry_least_s <= self.retry_s <= self.retry_most_s:
            expected = f"is not >= {self.retry_least_s}, retry_least_s, and <= {self.retry_most_s}, retry_most_s"
            raise error_at(("retry_s",), self.retry_s, expected)
        return self
