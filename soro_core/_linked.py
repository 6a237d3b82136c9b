"""Compiled functions that are only linked into kernels: no machine code, and no optimisation, of their own.

Numba makes machine code of every compiled function, and at every level of calls it optimises all callees
again. A function that only kernels call needs neither: the kernel's own passes optimise what is linked into
it. These are numba's own steps without those two (docs/adr/0012-linked-functions.md). Where it makes no
array, it counts no references to arrays either (docs/adr/0099-references-uncounted.md). They extend classes
that numba does not document, so pyproject.toml limits its release.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba import _dynfunc
from numba.core import caching, codegen, compiler, ir, typed_passes, types
from numba.core.compiler_machinery import register_pass


class LinkedLibrary(codegen.JITCodeLibrary):  # type: ignore[misc]  # numba is not typed
    """Code of one function, for other libraries to link."""

    def _optimize_final_module(self) -> None:
        """Do nothing: the library that links this one optimises it."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return what the cache stores: the name and LLVM code, since there is no object code."""
        return self.name, self._final_module.as_bitcode()

    @classmethod
    def load(cls, maker: Any, kept: tuple[str, bytes]) -> LinkedLibrary:
        """Return the library that the cache has stored."""
        name, code = kept
        library = cls(maker, name)
        library._final_module = codegen.ll.parse_bitcode(code)
        library._finalize_final_module()
        return library


def _callable(place: Any, environment: Any, library: LinkedLibrary) -> Any:
    """Return the object that represents the function in numba's tables; it has no code to call."""
    return _dynfunc.make_function(
        place.lookup_module(), place.qualname.split(".")[-1], "", 0, environment, (library,)
    )


# What only passes an array on that another variable, or a caller, holds.
_PASSING = {"build_tuple", "exhaust_iter", "cast", "phi"}
_STORING = (ir.SetAttr, ir.DynamicRaise, ir.DynamicTryRaise)


def _makes_array(state: Any) -> bool:
    """Whether a typed function returns an array, or has one made: then references to it are to be counted.

    All else uses arrays that its callers keep alive. To store an array (in an array, list or attribute), or
    to raise with values, is to have something made.
    """
    models = state.targetctx.data_model_manager

    def is_counted(kind: Any) -> bool:
        return bool(models[kind].contains_nrt_meminfo())

    def makes(stated: Any) -> bool:
        if isinstance(stated, ir.SetItem | ir.StaticSetItem):
            return is_counted(state.typemap[stated.value.name])
        if not (isinstance(stated, ir.Assign) and isinstance(stated.value, ir.Expr)):
            return isinstance(stated, _STORING)
        return is_counted(state.typemap[stated.target.name]) and not _passes(
            stated.value, state.typemap, is_counted
        )

    every = (stated for block in state.func_ir.blocks.values() for stated in block.body)
    return is_counted(state.return_type) or any(map(makes, every))


def _passes(made: ir.Expr, typemap: dict[str, Any], is_counted: Callable[[Any], bool]) -> bool:
    """Whether an expression only passes an array on, or a part of what holds it."""
    if made.op == "call":
        return isinstance(typemap[made.func.name], types.NamedTupleClass)
    if made.op not in ("getattr", "static_getitem", "getitem"):
        return made.op in _PASSING
    holder = typemap[made.value.name]
    # A list or an object gives a reference of its own; the views of `soro_core._box` count none.
    if is_counted(holder) and not isinstance(holder, types.Array | types.containers.BaseTuple):
        return False
    index = typemap[made.index.name] if made.op == "getitem" else types.intp
    return all(
        isinstance(one, types.Integer | types.misc.SliceType) for one in getattr(index, "types", [index])
    )


@register_pass(mutates_CFG=True, analysis_only=False)
class LinkedLowering(typed_passes.NativeLowering):  # type: ignore[misc]
    """Lowering into a `LinkedLibrary`."""

    _name = "linked_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower the function, and register the library that its callers link."""
        state.library = LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        if not _makes_array(state):
            state.targetctx.enable_nrt = False
        super().run_pass(state)
        lowered = state["cr"]
        function = _callable(lowered.fndesc, lowered.env, state.library)
        state.targetctx.insert_user_function(function, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=function)
        return True


class LinkedCompiler(compiler.CompilerBase):  # type: ignore[misc]
    """Numba's compiler with that lowering."""

    def define_pipelines(self) -> list[Any]:
        """Return its passes."""
        manager = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [
            (LinkedLowering if one is typed_passes.NativeLowering else one, name)
            for one, name in manager.passes
        ]
        manager.finalize()
        return [manager]


class LinkedResults(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """Cache entry of a linked function."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Restore a compile result from what `CompileResult._reduce` stored."""
        kept, place, environment, signature, objectmode, lifted, annotation, reloads, environments = payload
        for reload in reloads:
            reload()
        library = LinkedLibrary.load(target_context.codegen(), kept)
        return compiler.compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=environment,
            entry_point=_callable(place, environment, library),
            fndesc=place,
            type_annotation=annotation,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            reload_init=reloads,
            referenced_envs=environments,
        )


class LinkedCache(caching.FunctionCache):  # type: ignore[misc]
    """Cache of linked functions."""

    _impl_class = LinkedResults


def linked(function: Any, **flags: Any) -> Any:
    """Compile a function that only other kernels call.

    Parameters
    ----------
    function : callable
        Python function.
    **flags
        Options of `numba.njit`.
    """
    compiled = numba.njit(
        no_cpython_wrapper=True, no_cfunc_wrapper=True, pipeline_class=LinkedCompiler, **flags
    )(function)
    if isinstance(compiled, numba.core.dispatcher.Dispatcher):
        compiled._cache = LinkedCache(function)
    return compiled
