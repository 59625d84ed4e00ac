"""The state tables: every pair of a state and an input leads somewhere, or is our own misuse."""

from itertools import product
from typing import Any

import pytest

from cosim.errors import LocalProtocolError
from cosim.machine import next_state
from protocols.pseudonet import application, bluetooth
from protocols.pseudonet.application import Phase
from protocols.pseudonet.bluetooth import LinkState

# what is missing in the tables can only happen if this program drives a machine wrongly
MISUSE = {
    application: {
        (Phase.INITIALISATION, application.Input.EXCHANGED),
        (Phase.INITIALISATION, application.Input.DISAGREED),
        (Phase.INITIALISATION, application.Input.AGREED),
        (Phase.INITIALISATION, application.Input.DONE),
        (Phase.STATE_EXCHANGE, application.Input.DISAGREED),
        (Phase.STATE_EXCHANGE, application.Input.AGREED),
        (Phase.STATE_EXCHANGE, application.Input.DONE),
        (Phase.DECISION, application.Input.TEAM),
        (Phase.DECISION, application.Input.ARRIVED),
        (Phase.DECISION, application.Input.EXCHANGED),
        (Phase.DECISION, application.Input.BROKEN),
        (Phase.TERMINATION, application.Input.DISAGREED),
        (Phase.TERMINATION, application.Input.AGREED),
        (Phase.TERMINATION, application.Input.DONE),
        (Phase.TERMINATION, application.Input.DEPARTED),
    },
    bluetooth: {
        pair
        for pair in product(LinkState, bluetooth.LinkInput)
        if pair[1] not in (bluetooth.LinkInput.WAIT, bluetooth.LinkInput.BREAK_UP, bluetooth.LinkInput.PAGED)
        and pair
        not in {
            (LinkState.OFF, bluetooth.LinkInput.INITIATE),
            (LinkState.SCANNING, bluetooth.LinkInput.INITIATE),
            (LinkState.SCANNING, bluetooth.LinkInput.ALONE),
            (LinkState.INQUIRING, bluetooth.LinkInput.TOO_FEW),
            (LinkState.INQUIRING, bluetooth.LinkInput.ENOUGH),
            (LinkState.INQUIRING, bluetooth.LinkInput.ALONE),
            (LinkState.PAGING, bluetooth.LinkInput.NEXT),
            (LinkState.PAGING, bluetooth.LinkInput.ALL_PAGED),
            (LinkState.JOINED, bluetooth.LinkInput.ASSIGNED),
        }
    },
}
ROOMS = (
    (application, Phase, application.Input),
    (bluetooth, LinkState, bluetooth.LinkInput),
)
CASES = [(room, state, event) for room, states, inputs in ROOMS for state, event in product(states, inputs)]


@pytest.mark.parametrize(("room", "state", "event"), CASES, ids=lambda value: getattr(value, "name", None))
def test_every_pair_leads_to_a_state_or_is_refused(room: Any, state: Any, event: Any) -> None:
    if (state, event) in MISUSE[room]:
        with pytest.raises(LocalProtocolError, match=f"{event} is not legal in state {state}"):
            next_state(room.TABLE, state, event)
    else:
        action, following = next_state(room.TABLE, state, event)
        assert action
        assert following in type(state)


@pytest.mark.parametrize("room", [application, bluetooth])
def test_every_state_can_be_reached(room: Any) -> None:
    first = {application: Phase.INITIALISATION, bluetooth: LinkState.OFF}[room]
    reached = {first}
    for _ in room.TABLE:
        reached |= {following for (state, _), (_, following) in room.TABLE.items() if state in reached}
    assert reached == set(type(first))


def test_nothing_leads_out_of_termination() -> None:
    leads_to = {following for (state, _), (_, following) in application.TABLE.items() if state is Phase.TERMINATION}
    assert leads_to == {Phase.TERMINATION}
