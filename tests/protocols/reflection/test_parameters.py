"""Defaults that follow from the paper."""

import pytest

from protocols.reflection.parameters import Parameters


@pytest.mark.parametrize(
    ("algorithm", "shared"),
    [("potential_field", True), ("avoid_past", False), ("visbug", False), ("straight", False)],
)
def test_states_are_shared_by_default_with_the_potential_field_only(algorithm: str, shared: bool) -> None:
    assert Parameters.model_validate({"algorithm": algorithm}).states_shared is shared
    for told in (True, False):
        assert Parameters.model_validate({"algorithm": algorithm, "share_states": told}).states_shared is told
