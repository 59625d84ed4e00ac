"""Errors say whose fault it is, are builtin kinds too, and survive being made again from their arguments."""

import pickle

import pytest

from cosim.errors import CosimError, LocalProtocolError, UserError, WireError

KINDS = [(UserError, ValueError), (LocalProtocolError, RuntimeError), (WireError, ValueError)]


@pytest.mark.parametrize(("kind", "builtin"), KINDS)
def test_an_error_is_ours_and_a_builtin_kind(kind: type[CosimError], builtin: type[Exception]):
    assert issubclass(kind, CosimError)
    assert issubclass(kind, builtin)


@pytest.mark.parametrize("kind", [CosimError, *(kind for kind, _ in KINDS)])
def test_an_error_survives_processes_and_simpy(kind: type[CosimError]):
    error = kind("depot.yaml: team.size: 0 is not >= 1")
    for again in (type(error)(*error.args), pickle.loads(pickle.dumps(error))):
        assert type(again) is kind
        assert str(again) == "depot.yaml: team.size: 0 is not >= 1"


def test_what_a_user_sees_is_one_line_of_300_letters_at_most():
    assert str(UserError("map: 'a\nb\x1b\ud800': é is no file")) == "map: 'a\\nb\\x1b\\ud800': é is no file"
    long = UserError("depot.yaml: " + "x" * 1000 + " is not a file")
    assert len(str(long)) == 300
    assert str(long).startswith("depot.yaml: xxx")
    assert str(long).endswith("xxx is not a file")
    assert str(UserError(str(long))) == str(long)
