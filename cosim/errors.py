"""The errors that cosim raises, split by whose fault they are.

    CosimError
    +-- UserError (ValueError)             the user's input: one line, exit 2, no traceback
    +-- LocalProtocolError (RuntimeError)  our own misuse of a machine, a channel or the kernel: stops the run
    +-- WireError (ValueError)             bytes that do not decode; a machine turns it into an event

A peer's bad bytes never leave a machine as an exception. Every class is also a builtin kind, so that callers can
catch either. Constructors take one string: SimPy re-creates exceptions from ``args``.
"""

from collections.abc import Iterable
from importlib.util import find_spec


class CosimError(Exception):
    """Root of all errors that this program raises on purpose."""


class UserError(CosimError, ValueError):
    """Input of the user that cannot be used; its text is the one line that the user sees."""


class LocalProtocolError(CosimError, RuntimeError):
    """Our own code used a contract wrongly; always a bug here, never a peer's fault."""


class WireError(CosimError, ValueError):
    """Bytes that are not an encoding of anything; caught where bytes enter a machine."""


def check_extra(extra: str, user: str, modules: Iterable[str]) -> None:
    """Raise UserError if *modules*, which *user* needs and the extra *extra* installs, are not there."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise UserError(f"{user} need {', '.join(missing)}, not installed here: pip install 'cosim-robots[{extra}]'")
