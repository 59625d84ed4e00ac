"""Of which kinds the radios of a run are, by their numbers, as its scenario tells it in plain data."""

import json
from collections.abc import Mapping
from typing import Any, Final

LOW_ENERGY: Final = "ble"
"""The kind of radios of Bluetooth Low Energy,"""
ADHOC: Final = "adhoc"
"""and of those of 802.11."""


def parts_of(channel: Any, kind: str) -> dict[int, Any]:
    """Return the settings of the radios of that *kind* of a scenario's *channel*, by number; none if it is unknown."""
    try:
        parts = channel["radios"] if channel["kind"] == "radios" else [channel]
        return {radio: part for radio, part in enumerate(parts) if part["kind"] == kind}
    except (KeyError, TypeError):
        return {}


def channel_of(metadata: Mapping[str, str]) -> Any:
    """Return the channel of the scenario of a run, as the *metadata* of its tables tells it; None if it does not."""
    try:
        return json.loads(metadata["scenario"])["channel"]
    except (KeyError, TypeError, ValueError):
        return None
