"""Robots whose radios of several kinds share one air, with hosts that write down what reaches them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cosim.channels.base import Positions
from cosim.channels.kinds import ChannelSite
from cosim.channels.radios import SPEC, RadiosChannel, RadiosSettings, with_radio
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.kernel import WORLD, Kernel
from cosim.machine import Address, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import RECEPTIONS, TRANSMISSIONS, Table, Trace
from cosim.units import Time

FREE: dict[str, Any] = {"model": "free_space", "reference_loss_db": 40.2}


class Host:
    """The host at a robot."""

    def __init__(self) -> None:
        self.heard: list[tuple[Time, int, Address, bytes]] = []
        """(time, radio, source, payload)"""
        self.events: list[tuple[Time, LinkEvent]] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        self.heard.append((now, reception.radio, reception.source, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        self.events.append((now, event))

    def drain(self, now: Time) -> None:
        """Nothing is to be acted on."""


class SharedField:
    """Robots at *places_m*, each with the radios that it has *carried*, by number."""

    def __init__(
        self,
        radios: Sequence[dict[str, Any]],
        places_m: Sequence[tuple[float, float]],
        carried: Sequence[Sequence[int]] | None = None,
        tables: Iterable[Table] = (TRANSMISSIONS, RECEPTIONS),
        seed: int = 1,
        **settings: Any,
    ) -> None:
        size = len(places_m)
        self.moves: list[tuple[Time, Positions]] = []
        """Since when the robots are where."""
        self.kernel = Kernel()
        self.trace = Trace(with_radio(tables))
        carried = [tuple(range(len(radios)))] * size if carried is None else carried
        grid = segment_grid(np.empty((0, 4)))
        none: tuple[None, ...] = (None,) * size
        site = ChannelSite(
            *(self.kernel, self.trace, Streams(seed), size, grid, np.empty(0), packed_walls(grid)),
            *(carried, none, none, none),
        )
        faded = [{"propagation": FREE, **radio} for radio in radios]
        said = RadiosSettings.model_validate({"radios": faded, "air": "shared", **settings})
        self.channel: RadiosChannel = SPEC.make(said, site)
        self.hosts = [Host() for _ in range(size)]
        for address, host in enumerate(self.hosts):
            self.channel.attach(address, host)
        self.move(places_m)

    def move(self, places_m: Sequence[tuple[float, float]]) -> None:
        self.moves.append((self.kernel.now, np.array(places_m, dtype=np.float64)))
        self.channel.advance(self.kernel.now)
        self.channel.moved(np.array(places_m, dtype=np.float64))

    def at(self, time: Time, source: Address, *what: Outgoing | LinkCommand) -> None:
        """Have the host of *source* send payloads, or give commands, at *time*."""

        def act() -> None:
            for each in what:
                (self.channel.send if isinstance(each, Outgoing) else self.channel.command)(source, each)

        self.kernel.at(time, act, WORLD)

    def places_at(self, time: Time) -> Positions:
        """Return where the robots were at *time*."""
        return next(places for since, places in reversed(self.moves) if since <= time)

    def until(self, time: Time) -> None:
        self.kernel.run(time)
        self.channel.advance(time)

    def close(self) -> None:
        """Have everything written that has been kept."""
        self.channel.close(self.kernel.now)

    def rows(self, table: str) -> list[dict[str, Any]]:
        """Return the rows of a table that have been written."""
        columns = self.trace.columns(table)
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
