"""Machines as bytes, from the process of each to that which measures them: all that they know, and no more.

Metrics are read from what machines have counted. A function that was made within another, which has no name by which
another process finds it, and what no process can hand on, such as a view of memory, do not come along; in their places
stands a function that says so.
"""

import pickle
from collections.abc import Callable
from io import BytesIO
from types import BuiltinMethodType, FunctionType, ModuleType
from typing import Any

from cosim.errors import LocalProtocolError
from cosim.machine import Machine


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        """Return what makes the other process what stands for *obj*, if it does not come along."""
        if isinstance(obj, FunctionType):
            return (_stand_in, ()) if "<" in obj.__qualname__ else NotImplemented
        whole = obj.__self__ if isinstance(obj, BuiltinMethodType) else obj
        if not isinstance(whole, type | ModuleType):
            try:
                whole.__reduce_ex__(pickle.HIGHEST_PROTOCOL)
            except TypeError:
                return _stand_in, ()
        return NotImplemented


def _stand_in() -> Callable[..., Any]:
    return _left_behind


def _left_behind(*_: Any, **__: Any) -> Any:
    raise LocalProtocolError("what a live machine has left in its process is no part of what is measured")


def handed(machine: Machine) -> bytes:
    """Return *machine* as bytes; raise PicklingError, TypeError or AttributeError for what no process can hand on."""
    file = BytesIO()
    _Pickler(file, pickle.HIGHEST_PROTOCOL).dump(machine)
    return file.getvalue()
