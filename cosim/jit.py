"""Numba, with a cache that notices every edit and compiles no more than is called: where kernels take ``njit`` from.

Numba's own cache looks at the file of the compiled function only: it notices neither an edited callee in another file
nor an edited constant, which is compiled in. Ours keeps the kernels of a module in a folder of :mod:`cosim.caches`,
named by a digest of the module and of all that it imports. And it has a file for each signature, where numba's has one
index for all: of two processes that compile at once, each for other types, one could find the other's code.
"""

import hashlib
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, TypeVar
from uuid import uuid4

import numba
from llvmlite.binding import parse_bitcode
from numba.core import codegen, compiler, event, serialize, sigutils, types

from cosim.caches import begin, cache_folder, sources_digest

__all__ = ["COMPILES", "Count", "before_compiling", "counted_compilations", "njit"]

if "scipy.linalg" not in sys.modules:
    # numba's arithmetic of arrays, which the first kernel loads, looks for a BLAS and loads all of scipy.linalg for
    # that (0.3 s): it is not to look now, but when a kernel wants one, which none of ours does
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    from numba.np import arraymath

    del sys.modules["scipy.linalg"]
    arraymath._HAVE_BLAS = True


COMPILES: Final = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
"""False if the environment's NUMBA_DISABLE_JIT has kernels run as plain Python."""
# numba has no types
_type_of: Final[Any] = types.unliteral
_normalized: Final[Any] = sigutils.normalize_signature
_rebuilt: Final[Any] = compiler.CompileResult._rebuild
_dumped: Final[Any] = serialize.dumps
_Compiler: Final[Any] = compiler.Compiler
_Library: Final[Any] = codegen.JITCodeLibrary
Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def njit(*, borrows: bool = False, **options: Any) -> Callable[[Kernel], Kernel]:
    """Return a decorator that compiles a kernel on its first call, as numba's own with these *options* does.

    But a kernel that another one calls is compiled for the type of a constant, not once more for its value, and without
    what it takes to call it from Python or C, unless Python has called it before; and it becomes machine code only as a
    part of its callers. That spares half of all compiling.

    A kernel that only *borrows* arrays, makes none and returns none, does without counting who holds them: where many
    are handed on from kernel to kernel that is half of the time. What it calls may make some for itself,
    but hand it none: nobody would release it.
    """
    cached = options.pop("cache", False)
    options["_nrt"] = not borrows

    def compiled(function: Kernel, **more: Any) -> Any:
        kernel: Any = numba.njit(**options, **more)(function)
        if cached and function.__closure__ is None:
            kernel._cache = _Cache(function, "pipeline_class" in more)
        return kernel

    def part(function: Kernel) -> Any:
        return compiled(function, no_cfunc_wrapper=True, no_cpython_wrapper=True, pipeline_class=_PartCompiler)

    def decorate(function: Kernel) -> Kernel:
        if not COMPILES:
            return function
        kernel = compiled(function, no_cfunc_wrapper=True)
        _call_by_kernels(kernel, cache(lambda: part(function)))
        decorated: Kernel = kernel
        return decorated

    return decorate


def _call_by_kernels(kernel: Any, bare: Callable[[], Any]) -> None:
    """Have other kernels call *bare*() for *kernel*, but with signatures with which Python has called *kernel*."""
    resolve, overload = kernel.get_call_template, kernel.get_overload

    def get_call_template(args: Sequence[Any], named: Mapping[str, Any]) -> Any:
        plain, plain_named = [_type_of(each) for each in args], {name: _type_of(each) for name, each in named.items()}
        _, folded = kernel.fold_argument_types(plain, plain_named)
        return (resolve if tuple(folded) in kernel.overloads else bare().get_call_template)(plain, plain_named)

    def get_overload(signature: Any) -> Any:
        args, _ = _normalized(signature)
        return (overload if tuple(args) in kernel.overloads else bare().get_overload)(signature)

    kernel.get_call_template, kernel.get_overload = get_call_template, get_overload


class _Part(_Library):  # type: ignore[misc]
    """Code of a kernel that only kernels call: optimised, and made machine code, with what it is linked into."""

    codegen = SimpleNamespace(set_env=lambda name, env: None)
    """What numba gives a kernel's Python objects to: ours have none."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> Any:
        return self.serialize_using_bitcode()

    @classmethod
    def read_for(cls, target: Any) -> Any:
        """Return what is to numba the target of code that is read: it would make machine code of it."""

        def unserialize_library(state: tuple[str, str, bytes]) -> _Part:
            library = cls(target.codegen(), state[0])
            library._final_module = parse_bitcode(state[2])
            library._finalize_final_module()
            return library

        return SimpleNamespace(
            codegen=lambda: SimpleNamespace(unserialize_library=unserialize_library),
            get_executable=target.get_executable,
            typing_context=target.typing_context,
        )


class _PartCompiler(_Compiler):  # type: ignore[misc]
    """Compiler of a kernel to a part of its callers."""

    def define_pipelines(self) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _Cache:
    """The compiled code of a kernel on the disk: what a numba dispatcher asks of its cache."""

    def __init__(self, function: Callable[..., Any], part: bool) -> None:
        """Keep what *function* is compiled to, as a *part* of others or by itself."""
        code = function.__code__
        self._module, self._path = function.__module__, Path(code.co_filename)
        self._name = f"{function.__qualname__}-{code.co_firstlineno}"
        self._of = (part, numba.__version__, sys.implementation.cache_tag)
        self._part = part

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the code for *signature*, ready to run; None if there is none."""
        target.refresh()  # what a numba dispatcher expects of it
        try:
            kept_for, code = pickle.loads(self._file(signature, target.codegen()).read_bytes())
        except OSError:
            return None
        if kept_for != signature:
            return None
        return _rebuilt(_Part.read_for(target) if self._part else target, *code)

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the code for *signature*, if there is a place for it."""
        if result.library.has_dynamic_globals:
            warnings.warn(f"{self._name} holds an address, and is compiled in each process", stacklevel=2)
            return
        file = self._file(signature, result.codegen)
        written = file.with_name(f"{uuid4().hex}.new")
        with suppress(OSError):  # a full disk does not stop a run
            begin(file.parent)
            written.write_bytes(_dumped((signature, result._reduce())))
            os.replace(written, file)

    def _file(self, signature: Any, codegen: Any) -> Path:
        key = repr((signature, codegen.magic_tuple(), self._of))
        folder = _kernel_folder(self._module, self._path)
        return folder / f"{self._name}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.kernel"


@cache
def _kernel_folder(module: str, path: Path) -> Path:
    return cache_folder(module, sources_digest(module, path))


class _Compiling(event.Listener):
    """Listener of numba's that calls *tell* when the first compilation starts."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, _: object) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, _: object) -> None:
        pass


def before_compiling(tell: Callable[[], None]) -> AbstractContextManager[object]:
    """Return a context in which *tell* is called once, before the first kernel that the cache does not hold."""
    context: AbstractContextManager[object] = event.install_listener("numba:compile", _Compiling(tell))
    return context


class Count(event.Listener):
    """Listener of numba's that counts the kernels that are compiled."""

    def __init__(self) -> None:
        self.kernels = 0

    def on_start(self, _: object) -> None:
        """Count a kernel."""
        self.kernels += 1

    def on_end(self, _: object) -> None:
        """Do nothing: a kernel is counted once."""


def counted_compilations() -> AbstractContextManager[Count]:
    """Return a context that gives a count of the kernels compiled in it: those that the cache does not hold."""
    context: AbstractContextManager[Count] = event.install_listener("numba:compile", Count())
    return context
