"""The errors that cosim raises, split by whose fault they are.

    CosimError
    +-- UserError (ValueError)             the user's input: one line, exit 2, no traceback
    +-- LocalProtocolError (RuntimeError)  misuse of a machine, a channel or the kernel by the code here: stops the run
    +-- WireError (ValueError)             bytes that do not decode; a machine turns it into an event

A peer's bad bytes never leave a machine as an exception. Every class is also a builtin kind, so that callers can
catch either. Constructors take one string: SimPy re-creates exceptions from ``args``.
"""

from typing import Final

LONGEST_LINE: Final = 300
"""Letters of the longest error that a user sees."""


class CosimError(Exception):
    """Root of all errors that this program raises on purpose."""


class UserError(CosimError, ValueError):
    """Input of the user that cannot be used; its text is the one line that the user sees.

    What cannot be printed is written as an escape, and a text that is too long loses its middle: names and values of
    any length are repeated in it.
    """

    def __init__(self, text: str) -> None:
        line = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)
        if len(line) > LONGEST_LINE:
            line = f"{line[: LONGEST_LINE - 105]} ... {line[-100:]}"
        super().__init__(line)


class LocalProtocolError(CosimError, RuntimeError):
    """A protocol, or cosim itself, used a contract wrongly: a bug in the code that runs here, never a peer's fault."""


class WireError(CosimError, ValueError):
    """Bytes that are not an encoding of anything; caught where bytes enter a machine."""
