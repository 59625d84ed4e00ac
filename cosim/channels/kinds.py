"""The kinds of channels: what cosim must know of a channel to run it, and where it is found by name.

A channel is brought as a protocol is: by an entry point of the group ``cosim.channels``, or by ``module:name``, either
of which leads to a :class:`ChannelSpec`. Only the one that a scenario names is loaded.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import BeforeValidator, SerializeAsAny, ValidationError
from pydantic_core import InitErrorDetails

from cosim.arrays import Floats
from cosim.channels.air.shared import SharedAir
from cosim.channels.base import Channel
from cosim.channels.propagation import PropagationSettings
from cosim.geometry.segments import PackedWalls, SegmentGrid
from cosim.installed import find_installed, installed_names
from cosim.kernel import Kernel
from cosim.protocol import PayloadBytes
from cosim.randomness import Streams
from cosim.settings import Settings, error_at
from cosim.trace import Trace

GROUP = "cosim.channels"
"""The group of entry points."""
Strength: TypeAlias = Literal["power_dbm", "reach_m"]
"""A setting of a team by which robots' radios can be told to be stronger, or weaker, than the channel's."""


class ChannelSettings(Settings):
    """What a scenario can say about a channel: to be derived from, with a default for ``kind``."""

    kind: str

    @classmethod
    def kinds_with(cls, name: str) -> list[str]:
        """Return the other installed kinds of channels that have a setting called *name*."""
        found = []
        for kind in channel_kinds():
            with suppress(ValueError):  # one that cannot be loaded has none
                settings = channel_spec(kind).settings
                if settings is not cls and name in settings.model_fields:
                    found.append(kind)
        return found


class ChannelSite(NamedTuple):
    """What a channel is told of the run that it is part of."""

    kernel: Kernel
    trace: Trace
    streams: Streams
    size: int
    """Number of robots, and of stations in the background after them."""
    walls: SegmentGrid
    wall_loss_db: Floats
    """What each wall costs a signal, dB."""
    packed: PackedWalls
    """The walls, and the solid parts of the floor, as lines of sight meet them."""
    carried: Sequence[Sequence[int]]
    """The numbers of each robot's radios."""
    powers_dbm: Sequence[float | None]
    """Transmit power of each robot's radios; None where the channel decides."""
    reaches_m: Sequence[float | None]
    """How far each robot is heard; None where the channel decides."""
    power_classes: Sequence[int | None]
    """Power class of each robot's radio; None where the channel decides."""
    air: SharedAir | None = None
    """The air that the channel shares with others of the run; None if they do not hear each other."""


@dataclass(frozen=True)
class ChannelSpec:
    """What an entry point of the group ``cosim.channels`` names: all that cosim must know of a channel."""

    settings: type[ChannelSettings]
    """Model of the channel's settings in a scenario."""
    make: Callable[[Any, ChannelSite], Channel]
    """(settings, site) -> the channel of one run. Raise UserError for settings that do not fit the site."""
    strength: Callable[[Any], Strength | None] = lambda settings: None
    """(settings) -> the setting of a team that these make use of; None if they make use of neither."""
    links: Callable[[Any], int | None] = lambda settings: None
    """(settings) -> the most links of which a radio can be the master at once; None for any number."""
    payload_bytes: Callable[[Any], PayloadBytes] = lambda settings: PayloadBytes()
    """(settings) -> the longest payloads that are carried."""
    shares: Callable[[Any], bool] = lambda settings: True
    """(settings) -> False if links have times of their own, and ``Share`` divides no radio's time among piconets."""
    fades: Callable[[Any], PropagationSettings | None] | None = None
    """(settings) -> how its signals fade, None if they do not; None for radios that cannot share the air with others.

    Raise ValueError for settings with which they cannot.
    """
    listens: bool = False
    """True if its radios listen before they talk: no two channels of that kind share the air."""
    arbitrated: bool = False
    """True if its radios ask the arbiter of their robot before they use a shared air, where there is one."""


def channel_kinds() -> list[str]:
    """Return the names of the installed channels, sorted; load none of them."""
    return installed_names(GROUP)


def channel_spec(kind: str) -> ChannelSpec:
    """Return the channel that *kind* names: an entry point of the group ``cosim.channels``, or ``module:name``.

    Raise ValueError for a name that leads nowhere.
    """
    return find_installed(GROUP, kind, ChannelSpec, "channel")


def channel_settings(value: Any) -> ChannelSettings:
    """Return *value*, settings or plain data with a ``kind``, as the settings of that kind of channel.

    Raise ValidationError, or ValueError, for what they are not.
    """
    if isinstance(value, ChannelSettings):
        return value
    if not isinstance(value, Mapping):
        raise ValidationError.from_exception_data(
            "Settings", [InitErrorDetails(type="model_attributes_type", input=value)]
        )
    if "kind" not in value:
        raise error_at(("kind",), {**value}, f"is missing, in {value!r}")
    try:
        spec = channel_spec(value["kind"])
    except ValueError as error:
        raise error_at(("kind",), value["kind"], str(error)) from None
    return spec.settings.model_validate(value)


AnyChannel: TypeAlias = Annotated[SerializeAsAny[ChannelSettings], BeforeValidator(channel_settings)]
"""The settings of a channel of any kind, as a field of other settings."""


def channel_models(value: Any) -> dict[tuple[str | int, ...], type[Settings]]:
    """Return the models of the settings of the channel that *value*, plain data, describes, by their places in it."""
    try:
        models: dict[tuple[str | int, ...], type[Settings]] = {(): channel_spec(value["kind"]).settings}
    except (TypeError, KeyError, ValueError, AttributeError):  # wrong in itself: the validation says so
        return {}
    inner = value.get("radios")
    for radio, each in enumerate(inner if isinstance(inner, list | tuple) else ()):
        models |= {("radios", radio, *place): model for place, model in channel_models(each).items()}
    return models
