"""Machines as bytes, from the process of each to that which measures them: all that they know, but no nested functions.

Metrics are read from what machines have counted. A function that was made within another has no name by which another
process finds it; in its place stands one that says so.
"""

import pickle
from io import BytesIO
from types import FunctionType
from typing import Any, Final

from cosim.errors import LocalProtocolError
from cosim.machine import Machine

_NESTED: Final = "nested"


class _Pickler(pickle.Pickler):
    def persistent_id(self, obj: Any) -> str | None:
        """Return what stands for a nested function; None for all else."""
        return _NESTED if isinstance(obj, FunctionType) and "<" in obj.__qualname__ else None


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, pid: Any) -> Any:
        """Return what stands for a nested function."""
        return _left_behind


def _left_behind(*_: Any, **__: Any) -> Any:
    raise LocalProtocolError("a nested function of a live machine has not come along to be measured")


def handed(machine: Machine) -> bytes:
    """Return *machine* as bytes; raise PicklingError, TypeError or AttributeError for what no process can hand on."""
    file = BytesIO()
    _Pickler(file, pickle.HIGHEST_PROTOCOL).dump(machine)
    return file.getvalue()


def taken_back(data: bytes) -> Any:
    """Return the machine that *data* is."""
    return _Unpickler(BytesIO(data)).load()
