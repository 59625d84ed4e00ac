"""What a run is to be: frozen settings read from YAML, with every default in one place and errors that say where.

A scenario file is validated once into a :class:`Scenario`; ``--set`` and the digest work on its dump, in which all
defaults are written out. The folder of the file, against which a relative map path is resolved, is not part of the
dump: it travels as a private attribute.
"""

import glob
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    Field,
    PrivateAttr,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from cosim.channels.background import Station, stations_of
from cosim.channels.kinds import AnyChannel, ChannelSettings, channel_models, channel_settings, channel_spec
from cosim.channels.radios import RadiosSettings
from cosim.documents import (
    Assignment,
    Place,
    assign,
    in_turn,
    is_file,
    parse_assignment,
    parse_place,
    parse_yaml,
    read_bytes,
    read_yaml,
    validated,
)
from cosim.errors import UserError
from cosim.faults.settings import FaultSettings, RadioOffSettings, misplaced
from cosim.installed import find_installed, installed_names
from cosim.protocol import ProtocolSpec
from cosim.robots.body import BodySettings
from cosim.robots.senses import SenseSettings
from cosim.robots.trajectories import find_paths
from cosim.settings import Count, Decibels, Metres, Seconds, Seed, Settings, error_at
from cosim.units import SLOT, Time, from_seconds
from cosim.world.floorplan import FloorplanSettings

MOST_ROBOTS: Final = 10_000
FILES: Final = (("floorplan", "map"), ("team", "trajectories"))
"""Places of the settings that may name a file."""


def protocol_names() -> list[str]:
    """Return the names of the installed protocols, sorted."""
    return installed_names("cosim.protocols")


def protocol_spec(use: str) -> ProtocolSpec:
    """Return the protocol that *use* names: an entry point of the group ``cosim.protocols``, or ``module:name``.

    Raise ValueError for a name that leads nowhere.
    """
    return find_installed("cosim.protocols", use, ProtocolSpec, "protocol")


def _once(numbers: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(numbers)) < len(numbers):
        raise ValueError("names a radio twice")
    return numbers


PowerClass: TypeAlias = Literal[1, 2, 3]
RadioNumbers: TypeAlias = Annotated[tuple[Count, ...], Field(min_length=1), AfterValidator(_once)]


class GroupSettings(Settings):
    """Robots of a team that are alike."""

    size: Count = Field(default=1, ge=1, le=MOST_ROBOTS, description="number of robots")
    body: BodySettings | None = Field(default=None, description="their bodies; those of the team if not given")
    power_class: PowerClass | None = Field(default=None, description="of their radios; the team's if not given")
    radios: RadioNumbers | None = Field(default=None, description="which radios they have; the team's if not given")
    power_dbm: Decibels | None = Field(default=None, description="dBm, of their radios; the team's if not given")
    reach_m: Metres | None = Field(default=None, gt=0, description="m, of their radios; the team's if not given")


class TeamSettings(Settings):
    """The robots of a run: all alike, or groups of robots that are, numbered in the order of the groups."""

    size: Count = Field(default=4, ge=1, le=MOST_ROBOTS, description="number of robots; groups have sizes of their own")
    body: BodySettings = Field(default_factory=BodySettings, description="the robots' bodies")
    power_class: PowerClass | None = Field(
        default=None, description="of the robots' radios, 1 to 3; what the channel says if not given"
    )
    radios: RadioNumbers = Field(
        default=(0,), description="which radios a robot has, where the channel is of the kind radios"
    )
    power_dbm: Decibels | None = Field(
        default=None, description="dBm, transmit power of adhoc radios with propagation; the channel's if not given"
    )
    reach_m: Metres | None = Field(
        default=None,
        gt=0,
        description="m, how far others hear a robot by adhoc radios without propagation and by ideal ones, however far "
        "they reach themselves; the channel's range_m if not given",
    )
    groups: tuple[GroupSettings, ...] | None = Field(
        default=None, min_length=1, description="what a mixed team consists of; all robots are alike if not given"
    )
    starts: tuple[tuple[Metres, Metres], ...] | None = Field(
        default=None, description="m, where the robots start; drawn from the seed if not given"
    )
    trajectories: str | None = Field(
        default=None,
        description="file of paths that robots follow, whatever they are told: CSV (robot, time_s, x_m, y_m, maybe "
        "heading_rad) or ns-2 movements; robots that it does not name drive",
    )
    sight_range_m: Metres | None = Field(
        default=None, gt=0, description="m, how far a robot sees others; without limit if not given"
    )
    senses: SenseSettings = Field(
        default_factory=SenseSettings, description="sensors, for protocols whose robots look around"
    )

    @property
    def bodies(self) -> tuple[BodySettings, ...]:
        """The body of each robot."""
        return tuple(group.body or self.body for group in self._members())

    @property
    def power_classes(self) -> tuple[int | None, ...]:
        """The power class of each robot's radio; None where the channel decides."""
        return tuple(group.power_class or self.power_class for group in self._members())

    @property
    def powers_dbm(self) -> tuple[float | None, ...]:
        """The transmit power of each robot's adhoc radios, where signals fade; None where the channel decides."""
        return tuple(self.power_dbm if group.power_dbm is None else group.power_dbm for group in self._members())

    @property
    def reaches_m(self) -> tuple[float | None, ...]:
        """How far each robot is heard by radios whose signals do not fade; None where the channel decides."""
        return tuple(group.reach_m or self.reach_m for group in self._members())

    @property
    def carried(self) -> tuple[tuple[int, ...], ...]:
        """Which radios each robot has."""
        return tuple(group.radios or self.radios for group in self._members())

    def _members(self) -> list[GroupSettings]:
        groups = self.groups or (GroupSettings(size=self.size),)
        return [group for group in groups for _ in range(group.size)]

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        """Take the size of a mixed team from its groups; it cannot be given beside them, unless it is the same."""
        if self.groups is not None:
            together = sum(group.size for group in self.groups)
            if "size" in self.model_fields_set and self.size != together:
                raise error_at(("size",), self.size, f"is given, but groups have {together} robots together")
            object.__setattr__(self, "size", together)
        return self

    @model_validator(mode="after")
    def _one_start_each(self) -> Self:
        if self.starts is not None and len(self.starts) != self.size:
            raise error_at(("starts",), len(self.starts), f"positions are given for {self.size} robots")
        return self

    @model_serializer(mode="wrap")
    def _without_what_follows(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the size of a mixed team, so that its groups can be changed in a dump."""
        plain: dict[str, Any] = serialize(self)
        if self.groups is not None:
            del plain["size"]
        return plain


class ProtocolChoice(Settings):
    """Which protocol the robots run, with its own parameters."""

    use: str = Field(description="an installed protocol, or module:name")
    parameters: SerializeAsAny[Settings] = Field(
        default_factory=Settings, description="what the protocol's own model defines"
    )

    @field_validator("use")
    @classmethod
    def _exists(cls, use: str) -> str:
        protocol_spec(use)
        return use

    @field_validator("parameters", mode="before")
    @classmethod
    def _validated_by_the_protocol(cls, value: Any, info: Any) -> Any:
        """Let the protocol's model validate the parameters: pydantic merges its errors, under this field's path."""
        if "use" not in info.data:  # an error of its own; nothing to validate against
            return Settings()
        model = protocol_spec(info.data["use"]).parameters
        return model.model_validate(value.model_dump() if isinstance(value, Settings) else value)

    @property
    def spec(self) -> ProtocolSpec:
        """The protocol itself."""
        return protocol_spec(self.use)


class Scenario(Settings):
    """Everything that decides a run, but for its seed's replicate."""

    name: str = Field(default="scenario", description="what the run is called in tables")
    seed: Seed = Field(default=1, ge=0, description="of the first replicate; the next ones count up")
    duration_s: Seconds = Field(gt=0, description="s, simulated time at which the run ends at the latest")
    tick_s: Seconds = Field(default=0.1, gt=0, description="s, the world's tick: a whole number of slots of 625 us")
    floorplan: FloorplanSettings = Field(default_factory=FloorplanSettings, description="the floor and its walls")
    team: TeamSettings = Field(default_factory=TeamSettings, description="the robots")
    channel: AnyChannel = Field(
        default_factory=lambda: channel_settings({"kind": "ideal"}), description="what carries their messages"
    )
    protocol: ProtocolChoice = Field(description="what they run")
    faults: tuple[FaultSettings, ...] = Field(default=(), description="what goes wrong, and when")

    _folder: Path = PrivateAttr(default_factory=Path)

    @property
    def folder(self) -> Path:
        """The folder against which relative paths of files are resolved first."""
        return self._folder

    @property
    def tick(self) -> Time:
        """The world's tick in nanoseconds."""
        return from_seconds(self.tick_s)

    @property
    def duration(self) -> Time:
        """The longest simulated time in nanoseconds."""
        return from_seconds(self.duration_s)

    @property
    def radios(self) -> tuple[ChannelSettings, ...]:
        """The settings of the channel of each radio."""
        return self.channel.radios if isinstance(self.channel, RadiosSettings) else (self.channel,)

    @property
    def stations(self) -> tuple[Station, ...]:
        """The stations in the background, whose addresses come after those of the robots."""
        return stations_of(self.channel.background) if isinstance(self.channel, RadiosSettings) else ()

    def map_digests(self) -> list[str]:
        """Return the SHA-256 of the files that it names: the paths of robots, and the floor's if its map is one.

        Those are the map, its image, all that share its stem.
        """
        followed = find_paths(self.team.trajectories, self.folder) if self.team.trajectories else None
        paths = [] if followed is None else [hashlib.sha256(followed.read_bytes()).hexdigest()]
        places = [base / self.floorplan.map for base in (self.folder, Path())]
        found = next((place for place in places if is_file(place)), None)
        if found is None:
            return paths
        files = {*found.parent.glob(f"{glob.escape(found.stem)}.*")}
        if found.suffix in (".yaml", ".yml"):
            files |= {found.parent / image for image in _images_named(read_bytes(found))}
        return [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files) if is_file(path)] + paths

    def placed(self, folder: Path) -> Self:
        """Return a copy whose relative paths of files are resolved against *folder*."""
        copy = self.model_copy()
        copy._folder = folder
        return copy

    @field_validator("tick_s")
    @classmethod
    def _whole_slots(cls, tick_s: float) -> float:
        if from_seconds(tick_s) % SLOT or not from_seconds(tick_s):
            raise ValueError("is not a whole number of slots of 0.000625 s")
        return tick_s

    @model_validator(mode="after")
    def _addressable(self) -> Self:
        limit = self.protocol.spec.team_limit
        if limit is not None and self.team.size > limit:
            expected = f"is more than the {limit} robots that {self.protocol.use} can address"
            raise error_at(("team", "groups" if self.team.groups else "size"), self.team.size, expected)
        return self

    @model_validator(mode="after")
    def _radios_exist(self) -> Self:
        count = len(self.radios)
        named: list[tuple[tuple[str | int, ...], tuple[int, ...]]] = [(("radios",), self.team.radios)]
        named += [
            (("groups", n, "radios"), group.radios) for n, group in enumerate(self.team.groups or ()) if group.radios
        ]
        for place, radios in named:
            if max(radios) >= count:
                expected = f"names radio {max(radios)}, which is none of the channel's radios 0 to {count - 1}"
                raise error_at(("team", *place), list(radios), expected)
        return self

    @model_validator(mode="after")
    def _background_apart(self) -> Self:
        """Refuse stations in the background by a radio that robots have: they would be of the robots' network."""
        pairs = self.channel.background if isinstance(self.channel, RadiosSettings) else ()
        of_robots = {radio for radios in self.team.carried for radio in radios}
        for number, pair in enumerate(pairs):
            if pair.radio in of_robots:
                place = "channel", "background", number, "radio"
                raise error_at(
                    place, pair.radio, "is a radio of robots: stations in the background need one of their own"
                )
        return self

    @model_validator(mode="after")
    def _all_can_send(self) -> Self:
        """Refuse robots without the radio that their protocol sends by."""
        wanted = self.protocol.spec.radio
        for n, group in enumerate(self.team.groups or (GroupSettings(),)):
            radios = group.radios or self.team.radios
            if wanted is not None and wanted not in radios:
                place: tuple[str | int, ...] = ("groups", n, "radios") if group.radios else ("radios",)
                expected = f"lacks radio {wanted}, by which the robots of {self.protocol.use} send"
                raise error_at(("team", *place), list(radios), expected)
        return self

    @model_validator(mode="after")
    def _powers_and_reaches_matter(self) -> Self:
        """Refuse a power or a reach of robots that have no radio which makes use of it."""
        team = self.team
        given: list[tuple[tuple[str | int, ...], TeamSettings | GroupSettings, set[int]]]
        given = [((), team, {radio for radios in team.carried for radio in radios})]
        given += [(("groups", n), group, {*(group.radios or team.radios)}) for n, group in enumerate(team.groups or ())]
        for place, robots, radios in given:
            settings = [self.radios[radio] for radio in sorted(radios)]
            uses = {channel_spec(each.kind).strength(each) for each in settings}
            for field, which in _STRENGTHS.items():
                value = getattr(robots, field)
                if value is not None and field not in uses:
                    raise error_at(("team", *place, field), value, f"is given, but their radios are not {which}")
        return self

    @model_validator(mode="after")
    def _faults_can_happen(self) -> Self:
        wrong = misplaced(self.faults, self.team.size, self.duration_s)
        if wrong is not None:
            number, field, expected = wrong
            raise error_at(("faults", number, field), getattr(self.faults[number], field), expected)
        return self

    @model_validator(mode="after")
    def _faults_name_radios_that_exist(self) -> Self:
        for number, fault in enumerate(self.faults):
            radio = getattr(fault, "radio", None)
            whose, known = "the channel", tuple(range(len(self.radios)))
            if isinstance(fault, RadioOffSettings):
                whose, known = f"robot {fault.robot}", self.team.carried[fault.robot]
            if radio is not None and radio not in known:
                expected = f"is none of the radios of {whose}: {', '.join(map(str, known))}"
                raise error_at(("faults", number, "radio"), radio, expected)
        return self


_STRENGTHS: Final = {"power_dbm": "adhoc with propagation", "reach_m": "ideal, or adhoc without propagation"}
"""What a team can say of its radios' strength, and of which radios."""


@cache  # every arm of a sweep asks for the same few maps
def _images_named(content: bytes) -> tuple[str, ...]:
    """Return the image that the YAML *content* of a ROS map names; none for what is no such map."""
    try:
        plain = parse_yaml(content.decode(), "map")
    except (UserError, UnicodeDecodeError):  # broken in itself: loading the floor will say so, with its name
        return ()
    image = plain.get("image") if isinstance(plain, dict) else None
    return (image,) if isinstance(image, str) else ()


# ---------------------------------------------------------------- files


def load(path: str | Path, sets: Iterable[str] = ()) -> Scenario:
    """Return the scenario in the YAML file *path*, changed by *sets*, texts such as ``team.size=3``.

    Raise UserError, one line, for anything that is wrong with either.
    """
    assignments = [given_here(parse_assignment(text)) for text in sets]
    path = Path(path)
    return build(read_yaml(path), str(path), path.parent, assignments)


def build(plain: dict[str, Any], source: str, folder: Path, assignments: Sequence[Assignment] = ()) -> Scenario:
    """Return the scenario that *plain*, read from *source*, describes; map paths in it are relative to *folder*."""
    scenario = validated(Scenario, plain, source, (), _chosen_models(plain))
    for group in in_turn(assignments):
        other = assign(dump(scenario), group)
        scenario = validated(Scenario, other, source, group, _chosen_models(other))
    return scenario.placed(folder)


def changed(scenario: Scenario, changes: Mapping[str, Any], source: str, folder: Path) -> Scenario:
    """Return *scenario* with other settings, by their paths; map paths are relative to *folder*.

    Raise UserError, naming *source*, for a setting that it does not have or that cannot be.
    """
    assignments = [Assignment(parse_place(path), value, f"{source}: {path}") for path, value in changes.items()]
    return build(dump(scenario), "scenario", folder, assignments)


def given_here(item: Assignment) -> Assignment:
    """Return *item* from the command line, with a file's path relative to the working directory made absolute."""
    if item.place in FILES and isinstance(item.value, str) and is_file(Path(item.value)):
        return item._replace(value=str(Path(item.value).resolve()))
    return item


def _chosen_models(plain: dict[str, Any]) -> dict[Place, type[Settings]]:
    """Return the models of those settings of which the document says what they are, by their places."""
    models: dict[Place, type[Settings]] = {
        ("channel", *place): model for place, model in channel_models(plain.get("channel")).items()
    }
    with suppress(TypeError, KeyError, ValueError, AttributeError):  # wrong in itself: the validation says so
        models["protocol", "parameters"] = protocol_spec(plain["protocol"]["use"]).parameters
    return models


def dump(settings: Settings) -> dict[str, Any]:
    """Return *settings* as plain data for YAML or JSON, with all defaults written out."""
    return settings.model_dump(mode="json")


def digest(plain: Any) -> str:
    """Return the SHA-256 of plain data, such as ``dump(scenario)``: the order of its keys has no meaning."""
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
