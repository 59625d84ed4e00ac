"""Several radios for each robot: channels side by side, in bands of their own, or in one air in which all hear all.

Not every robot has all of them. A radio that a robot does not have is a device that is always switched off: it neither
sends nor hears, and no robot has it in reach.

Each radio has links of its own: it carries out the link commands that name it, and link events name the radio that they
come from. A host learns by another radio than the first only of links that were made by it: what has none, such as the
ideal channel, reports every device that is switched off as lost, which radio 0 does for all. Radio 0 behaves as if it
were the only one: it draws from the same streams, and the others from streams of their own.

With ``air: apart`` radios of different numbers know nothing of each other. With ``air: shared`` all are in the band of
2.4 GHz, and what one sends disturbs the others, by one law of propagation, as far as the spectra overlap. A robot's own
radios are as far from each other as their isolation says. They work at the same time, unless
``arbitration`` has them ask before they send.

Pairs of stations in the background have radios that no robot has, and addresses after those of the robots.
"""

from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny, field_validator, model_validator

from cosim.channels.air.arbitration import Arbitration
from cosim.channels.air.shared import SharedAir
from cosim.channels.background import METRICS as BACKGROUND_METRICS
from cosim.channels.background import Background, PairSettings
from cosim.channels.base import Channel, Endpoint, Flying, Positions
from cosim.channels.kinds import (
    ChannelSettings,
    ChannelSite,
    ChannelSpec,
    channel_kinds,
    channel_settings,
    channel_spec,
)
from cosim.channels.propagation import Propagation, PropagationSettings
from cosim.errors import LocalProtocolError
from cosim.intervals import Interval
from cosim.kernel import Kernel
from cosim.machine import Address, Connected, LinkCommand, LinkEvent, Lost, Outcome, Outgoing, Reception
from cosim.payloads import HeldRow
from cosim.protocol import Metric
from cosim.randomness import Draws, Streams
from cosim.settings import Decibels, error_at
from cosim.trace import CALLS, FRAMES, INTERVALS, PAYLOADS, RECEPTIONS, TRANSMISSIONS, UNSENT, Table, Trace
from cosim.trace import Field as Column
from cosim.units import Time

_REFUSED: Final = Metric("refused", "1", "how often robots' radios had to leave the air to another one of the robot")
_PAYLOAD_BYTES: Final = Metric("payload_bytes", "B", "bytes of the payloads that hosts have sent")
RADIO: Final = Column("radio", "int", "", "which of the robots' radios")
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster
OF_RADIOS: Final = (FRAMES.name, TRANSMISSIONS.name, RECEPTIONS.name, UNSENT.name, PAYLOADS.name)
"""Tables whose rows have the number of a radio if there are several."""
_RADIO_AT: Final = [field.name for field in INTERVALS.fields].index(RADIO.name)


def _one_radio(value: Any) -> ChannelSettings:
    settings = channel_settings(value)
    if isinstance(settings, RadiosSettings):
        others = ", ".join(kind for kind in channel_kinds() if kind != settings.kind)
        raise error_at(("kind",), settings.kind, f"is not a channel for one radio: expected one of {others}")
    return settings


class RadiosSettings(ChannelSettings):
    """Several radios a robot, each on a channel of its own."""

    kind: Literal["radios"] = "radios"
    radios: tuple[Annotated[SerializeAsAny[ChannelSettings], BeforeValidator(_one_radio)], ...] = Field(
        description="the channels of radio 0, 1 and so on; which robot has which stands in the team"
    )

    air: Literal["apart", "shared"] = Field(
        default="apart", description="whether radios of different numbers hear each other: not at all, or as they do"
    )
    isolation_db: Decibels = Field(
        default=20.0, ge=0, description="dB between the antennas of a robot's radios, where the air is shared"
    )
    arbitration: bool = Field(
        default=False, description="whether a robot's radios ask before they send, where the air is shared"
    )
    background: tuple[PairSettings, ...] = Field(
        default=(), description="pairs of stations that are no robots and send all the time, by radios of their own"
    )

    @field_validator("radios")
    @classmethod
    def _not_none(cls, radios: tuple[ChannelSettings, ...]) -> tuple[ChannelSettings, ...]:
        if not radios:  # a length among the field's own bounds would be missed also where one of the radios is wrong
            raise ValueError("is empty, expected a channel for each radio")
        return radios

    @model_validator(mode="after")
    def _pairs_can_send(self) -> Self:
        for number, pair in enumerate(self.background):
            place = "background", number
            if pair.radio >= len(self.radios):
                expected = f"is none of the channel's radios 0 to {len(self.radios) - 1}"
                raise error_at((*place, "radio"), pair.radio, expected)
            settings = self.radios[pair.radio]
            most = channel_spec(settings.kind).payload_bytes(settings).unicast
            if most is not None and pair.payload_bytes > most:
                expected = f"is more than the {most} bytes that radio {pair.radio} carries at once"
                raise error_at((*place, "payload_bytes"), pair.payload_bytes, expected)
        return self

    @model_validator(mode="after")
    def _can_share(self) -> Self:
        if self.air == "shared":
            laws = [_law(radio, each) for radio, each in enumerate(self.radios)]
            for radio, law in enumerate(laws):
                if law != laws[0]:
                    raise error_at(("radios", radio, "propagation"), law, "is not that of radio 0: the air is shared")
            listeners = [radio for radio, each in enumerate(self.radios) if channel_spec(each.kind).listens]
            if len(listeners) > 1:
                place = "radios", listeners[1], "kind"
                raise error_at(place, self.radios[listeners[1]].kind, "shares no air with another one of its kind")
        return self

    @model_validator(mode="after")
    def _can_arbitrate(self) -> Self:
        if self.arbitration and self.air != "shared":
            raise error_at(("arbitration",), True, "needs air: shared: radios that are apart do not meet")
        for radio, each in enumerate(self.radios if self.arbitration else ()):
            if not channel_spec(each.kind).arbitrated:
                place = "radios", radio, "kind"
                raise error_at(place, each.kind, "has no arbitration")
        return self


def _law(radio: int, settings: ChannelSettings) -> PropagationSettings:
    """Return how the signals of *radio* fade in an air that is shared; raise an error if they cannot."""
    fades = channel_spec(settings.kind).fades
    place = "radios", radio
    if fades is None:
        raise error_at((*place, "kind"), settings.kind, "shares no air: its radios are not those of 2.4 GHz")
    try:
        law = fades(settings)
    except ValueError as error:
        raise error_at(place, settings.kind, f"shares no air, {error}") from None
    if law is None:
        told = "is missing: a shared air needs a law, such as {model: free_space}"
        raise error_at((*place, "propagation"), settings, told)
    return law


# ---------------------------------------------------------------- what a radio's own channel is given


class RadioStreams(Streams):
    """The randomness of one radio's channel; that of radio 0 is the run's, as if there were no others."""

    def __init__(self, streams: Streams, radio: int) -> None:
        super().__init__(streams.seed)
        self._names: tuple[str | int, ...] = ("radio", radio) if radio else ()

    def __call__(self, *names: str | int) -> np.random.Generator:
        """Return a fresh generator of this radio's stream *names*."""
        return super().__call__(*self._names, *names)

    def draws(self, *names: str | int) -> Draws:
        """Return the counter-based draws of this radio's stream *names*."""
        return super().draws(*self._names, *names)


class RadioTrace(Trace):
    """The trace of a run as one radio's channel writes to it: adds the radio's number to frames, and keeps nothing."""

    def __init__(self, whole: Trace, radio: int) -> None:
        super().__init__()
        self.tables = whole.tables
        self._whole = whole
        self._radio = radio

    def row(self, table: Table, *values: Any) -> None:
        """Append a row."""
        self._whole.row(table, *self._with_radio(table, values))

    def put(self, table: Table, *values: Any) -> None:
        """Append a row whose values are looked at later."""
        self._whole.put(table, *self._with_radio(table, values))

    def _with_radio(self, table: Table, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if table.name in OF_RADIOS:
            return (*values, self._radio)
        if table.name == INTERVALS.name:
            return (*values[:_RADIO_AT], self._radio, *values[_RADIO_AT + 1 :])
        return values

    def rows(self, table: Table, *columns: Any) -> None:
        """Append rows by column."""
        radios = array("q", (self._radio,)) * len(columns[0])
        if table.name in OF_RADIOS:
            columns = (*columns, radios)
        elif table.name == INTERVALS.name:
            columns = (*columns[:_RADIO_AT], radios, *columns[_RADIO_AT + 1 :])
        self._whole.rows(table, *columns)

    def event(self, time: int, source: int, event: Any) -> None:
        """Append an event."""
        self._whole.event(time, source, event)


class StationsTrace(RadioTrace):
    """The same of a radio of stations in the background: what their layers call is left out, which are no robot's."""

    def row(self, table: Table, *values: Any) -> None:
        """Append a row."""
        if table.name != CALLS.name:
            super().row(table, *values)


def with_radio(tables: Iterable[Table]) -> tuple[Table, ...]:
    """Return *tables* with another column, the last one, in those of frames: the radio."""
    return tuple(
        table._replace(fields=(*table.fields, RADIO)) if table.name in OF_RADIOS else table for table in tables
    )


class _End:
    """A robot's end of one of its radios."""

    def __init__(self, endpoint: Endpoint, radio: int, carriers: frozenset[Address]) -> None:
        self._endpoint = endpoint
        self._radio = radio
        self._carriers = carriers
        """Robots that have that radio."""
        self._linked: set[Address] = set()
        """Robots to which a link has been made by it, and has not been lost."""

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool | None:
        """Take a payload; return False if there is nothing to act on."""
        return self._endpoint.receive(data, _new(Reception, (*reception[:3], self._radio)), now)

    def link(self, event: LinkEvent, now: Time) -> bool | None:
        """Take a link event that concerns the host; return False if there is nothing to act on."""
        if isinstance(event, Connected):
            self._linked.add(event.peer)
        elif isinstance(event, Lost):
            known = self._carriers if self._radio == 0 else self._linked
            if event.peer not in known:
                return False
            self._linked.discard(event.peer)
        return self._endpoint.link(replace(event, radio=self._radio) if self._radio else event, now)

    def drain(self, now: Time) -> None:
        """Act on what came in at this instant."""
        self._endpoint.drain(now)


# ---------------------------------------------------------------- all radios together


class RadiosChannel(Channel):
    """All radios of a run."""

    def __init__(
        self,
        kernel: Kernel,
        trace: Trace,
        parts: Sequence[Channel],
        carried: Sequence[Sequence[int]],
        air: SharedAir | None = None,
        background: Background | None = None,
    ) -> None:
        """*parts* are the channels by radio, *carried* the radios that each robot has, *air* is what *parts* share."""
        super().__init__(kernel, trace, len(carried))
        self._air = air
        self._arbitration = None if air is None else air.arbitration
        self._background = background or Background((), self.size)
        self._parts = tuple(parts)
        self._carried = tuple(map(tuple, carried))
        self._payload_bytes = [0] * len(parts)
        self._carriers = [
            frozenset(robot for robot, radios in enumerate(carried) if radio in radios) for radio in range(len(parts))
        ]
        for radio, part in enumerate(parts):
            for address, radios in enumerate((*carried, *self._background.carried)):
                if radio not in radios:
                    part.power(address, False)
                    part.intervals.end(address, "off", kernel.now)  # it has no such radio

    @property
    def parts(self) -> tuple[Channel, ...]:
        """The channels, by radio."""
        return self._parts

    def carried(self, address: Address) -> tuple[int, ...]:
        """Return which radios who has *address* has: a robot, or a station in the background."""
        return (*self._carried, *self._background.carried)[address]

    def attach(self, address: Address, endpoint: Endpoint) -> None:
        """Deliver what arrives at *address* by any radio to *endpoint*."""
        super().attach(address, endpoint)
        for radio, (part, carriers) in enumerate(zip(self._parts, self._carriers, strict=True)):
            plain = radio == 0 and len(carriers) == self.size
            part.attach(address, endpoint if plain else _End(endpoint, radio, carriers))

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at the radio that it names; raise LocalProtocolError if the robot has no such radio."""
        radio = outgoing.radio
        if radio not in self._carried[source]:
            raise LocalProtocolError(f"robot {source} has no radio {radio}")
        self._payload_bytes[radio] += len(outgoing.payload)
        self._parts[radio].send(source, outgoing)

    def command(self, source: Address, command: LinkCommand) -> None:
        """Have a radio carry out a command that names it; raise LocalProtocolError if the robot has no such radio."""
        if command.radio not in self._carried[source]:
            raise LocalProtocolError(f"robot {source} has no radio {command.radio}")
        self._parts[command.radio].command(source, command)

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        """Return the robots that would hear *address* now by any of its radios, in order."""
        return tuple(sorted({other for part in self._parts for other in part.in_reach(address)}))

    def advance(self, now: Time) -> None:
        """Bring all channels up to *now*."""
        for part in self._parts:
            part.advance(now)

    def moved(self, positions_m: Positions) -> None:
        """Take the robots' new positions."""
        positions_m = self._background.among(positions_m)
        if self._air is not None:
            self._air.moved(positions_m)
        for part in self._parts:
            part.moved(positions_m)

    def power(self, address: Address, on: bool) -> None:
        """Switch all radios that the robot *address* has on or off."""
        for radio in self._carried[address]:
            self._parts[radio].power(address, on)

    def under_way(self, now: Time) -> list[Interval]:
        """Return what all radios are doing *now*, each interval with its radio's number."""
        of_each = enumerate(part.under_way(now) for part in self._parts)
        return [interval._replace(radio=radio) for radio, intervals in of_each for interval in intervals]

    def flying(self, now: Time) -> list[Flying]:
        """Return the frames of all radios that are on the air *now*."""
        return [each._replace(radio=radio) for radio, part in enumerate(self._parts) for each in part.flying(now)]

    def held(self, now: Time) -> list[HeldRow]:
        """Return rows of the payloads that all radios hold *now*, each with its radio's number."""
        return [(*row, radio) for radio, part in enumerate(self._parts) for row in part.held(now)]

    def close(self, now: Time) -> None:
        """Write the intervals of all radios that are not over."""
        if self._arbitration is not None:
            self._arbitration.close(now)
        for part in self._parts:
            part.close(now)

    # ------------------------------------------------------------ counts

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The metrics of all robots' channels, summed up under their own names, and those of each radio."""
        total = {metric.name: metric for part in self._robots_parts for metric in part.columns}
        of_each = [
            Metric(f"radio_{radio}_{metric.name}", metric.unit, f"{metric.meaning}; by radio {radio}")
            for radio, part in enumerate(self._parts)
            for metric in (*part.columns, *self._own_metrics(radio))
        ]
        return (*total.values(), *of_each)

    @property
    def _robots_parts(self) -> list[Channel]:
        """The channels of all radios but those in the background."""
        return [part for radio, part in enumerate(self._parts) if radio not in self._background.radios]

    def _own_metrics(self, radio: int) -> tuple[Metric, ...]:
        """Return what is counted here of *radio*."""
        if radio in self._background.radios:
            return BACKGROUND_METRICS
        return (_PAYLOAD_BYTES,) if self._arbitration is None else (_PAYLOAD_BYTES, _REFUSED)

    @property
    def uses(self) -> frozenset[str]:
        """The names of those that say what radios have used, of all together and of each radio."""
        of_each = (f"radio_{radio}_{name}" for radio, part in enumerate(self._parts) for name in part.uses)
        return frozenset(of_each).union(*(part.uses for part in self._robots_parts))

    @property
    def unsent(self) -> Counter[tuple[Address, Outcome]]:
        """Number of robots' payloads that were never on the air by any radio, by sender and reason."""
        return sum((part.unsent for part in self._robots_parts), Counter())

    def summary(self) -> dict[str, float]:
        """Return what the channels counted: summed up for the robots, and by radio."""
        total: dict[str, float] = {}
        of_each: dict[str, float] = {}
        for radio, (part, octets) in enumerate(zip(self._parts, self._payload_bytes, strict=True)):
            counts = part.summary()
            if radio in self._background.radios:
                counts |= self._background.counts(radio)
            else:
                for name, count in counts.items():
                    total[name] = total.get(name, 0.0) + count
                counts |= {_PAYLOAD_BYTES.name: float(octets)}
                if self._arbitration is not None:
                    counts |= {_REFUSED.name: float(self._arbitration.refused(radio))}
            of_each |= {f"radio_{radio}_{name}": count for name, count in counts.items()}
        return total | of_each


def _made(settings: RadiosSettings, site: ChannelSite) -> RadiosChannel:
    parts, air = [], None
    background = Background(settings.background, site.size)
    everyone = _with_stations(site, background)
    if settings.air == "shared":
        law, draws = _law(0, settings.radios[0]), site.streams.draws("shadowing")
        propagation = Propagation(law, site.walls, site.wall_loss_db, draws)
        arbitration = Arbitration(everyone.carried) if settings.arbitration else None
        air = SharedAir(site.kernel, everyone.size, propagation, settings.isolation_db, arbitration)
    for radio, each in enumerate(settings.radios):
        trace = (StationsTrace if radio in background.radios else RadioTrace)(site.trace, radio)
        own = everyone._replace(trace=trace, streams=RadioStreams(site.streams, radio), air=air)
        parts.append(channel_spec(each.kind).make(each, own))
    channel = RadiosChannel(site.kernel, site.trace, parts, site.carried, air, background)
    background.begin(site.kernel, parts, site.streams)
    return channel


def _with_stations(site: ChannelSite, background: Background) -> ChannelSite:
    """Return *site* with the stations of *background* after the robots."""
    unsaid = (None,) * len(background.carried)
    return site._replace(
        size=site.size + len(unsaid),
        carried=(*site.carried, *background.carried),
        powers_dbm=(*site.powers_dbm, *unsaid),
        reaches_m=(*site.reaches_m, *unsaid),
        power_classes=(*site.power_classes, *unsaid),
    )


SPEC: Final = ChannelSpec(RadiosSettings, _made)
"""The channel."""
