"""Compile a function as a part of those that call it.

Numba optimises every function together with all that it calls, and once more as a part of each of
its callers: code of many levels passes the whole optimiser at every level, and machine code is made
for functions that nobody calls from outside. A *part* is typed and lowered as usual, but handed to
its callers as it is: the optimiser sees it once, in the function that Python calls.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

__all__ = ["PartCompiler"]


class _NoEnvironment:
    """A code generator to which no Python environment needs to be given."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """Parts hold no Python objects."""


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code to be linked into that of the callers; it has no address."""

    @property
    def codegen(self) -> Any:
        return _NoEnvironment(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


_FOR_ARRAYS_TO_COME = (InlineClosureLikes, NopythonRewrites)
"""Passes that look for list comprehensions and array expressions: parts allocate nothing."""


class PartCompiler(CompilerBase):  # type: ignore[misc]
    """The usual passes, as far as parts need them, into a library that only serves callers."""

    def define_pipelines(self) -> list[Any]:
        if self.state.library is None:
            codegen = self.state.targetctx.codegen()
            self.state.library = _PartLibrary(codegen, self.state.func_id.func_qualname)
        usual = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager = PassManager("part")
        manager.passes.extend(each for each in usual.passes if each[0] not in _FOR_ARRAYS_TO_COME)
        manager.finalize()
        return [manager]
