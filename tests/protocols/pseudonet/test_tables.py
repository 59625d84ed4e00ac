"""The state tables: every pair of a state and an input leads somewhere, or is our own misuse."""

from itertools import product
from typing import Any

import pytest

from cosim.errors import LocalProtocolError
from cosim.machine import next_state
from protocols.pseudonet import bluetooth, phases
from protocols.pseudonet.bluetooth import Setup
from protocols.pseudonet.phases import Phase

# what is missing in the tables can only happen if this program drives a machine wrongly
MISUSE = {
    phases: {
        (Phase.INITIALISATION, phases.Input.EXCHANGED),
        (Phase.INITIALISATION, phases.Input.DISAGREED),
        (Phase.INITIALISATION, phases.Input.AGREED),
        (Phase.INITIALISATION, phases.Input.DONE),
        (Phase.STATE_EXCHANGE, phases.Input.DISAGREED),
        (Phase.STATE_EXCHANGE, phases.Input.AGREED),
        (Phase.STATE_EXCHANGE, phases.Input.DONE),
        (Phase.DECISION, phases.Input.TEAM),
        (Phase.DECISION, phases.Input.ARRIVED),
        (Phase.DECISION, phases.Input.EXCHANGED),
        (Phase.DECISION, phases.Input.BROKEN),
        (Phase.TERMINATION, phases.Input.DISAGREED),
        (Phase.TERMINATION, phases.Input.AGREED),
        (Phase.TERMINATION, phases.Input.DONE),
    },
    bluetooth: {
        pair
        for pair in product(Setup, bluetooth.Input)
        if pair[1] not in (bluetooth.Input.WAIT, bluetooth.Input.BREAK_UP, bluetooth.Input.PAGED)
        and pair
        not in {
            (Setup.OFF, bluetooth.Input.INITIATE),
            (Setup.SCANNING, bluetooth.Input.INITIATE),
            (Setup.SCANNING, bluetooth.Input.ALONE),
            (Setup.INQUIRING, bluetooth.Input.TOO_FEW),
            (Setup.INQUIRING, bluetooth.Input.ENOUGH),
            (Setup.INQUIRING, bluetooth.Input.ALONE),
            (Setup.PAGING, bluetooth.Input.NEXT),
            (Setup.PAGING, bluetooth.Input.ALL_PAGED),
            (Setup.JOINED, bluetooth.Input.ASSIGNED),
        }
    },
}
CASES = [
    (room, state, event)
    for room, states in ((phases, Phase), (bluetooth, Setup))
    for state, event in product(states, room.Input)
]


@pytest.mark.parametrize(("room", "state", "event"), CASES, ids=lambda value: getattr(value, "name", None))
def test_every_pair_leads_to_a_state_or_is_refused(room: Any, state: Any, event: Any) -> None:
    if (state, event) in MISUSE[room]:
        with pytest.raises(LocalProtocolError, match=f"{event} is not legal in state {state}"):
            next_state(room.TABLE, state, event)
    else:
        action, following = next_state(room.TABLE, state, event)
        assert action
        assert following in type(state)


@pytest.mark.parametrize("room", [phases, bluetooth])
def test_every_state_can_be_reached(room: Any) -> None:
    first = {phases: Phase.INITIALISATION, bluetooth: Setup.OFF}[room]
    reached = {first}
    for _ in room.TABLE:
        reached |= {following for (state, _), (_, following) in room.TABLE.items() if state in reached}
    assert reached == set(type(first))


def test_nothing_leads_out_of_termination() -> None:
    leads_to = {following for (state, _), (_, following) in phases.TABLE.items() if state is Phase.TERMINATION}
    assert leads_to == {Phase.TERMINATION}
