"""One name for a pair of kernels: which one is meant follows from the type of the first argument.

Numba's own `overload` would put a function between the two, and every such level is compiled with all that
lies below it; a choice made while types are inferred costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core.datamodel import models
from numba.core.imputils import lower_constant
from numba.extending import register_model, typeof_impl

Function = TypeVar("Function", bound=Callable[..., Any])


class Choice:
    """A pair of compiled functions of equal arguments; use `by_type`."""

    def __init__(self, kind: type, its: Any, others: Any) -> None:
        self.kind, self.its, self.others = kind, its, others

    def __call__(self, first: Any, *rest: Any) -> Any:
        """Call one of them, without compiling."""
        return (self.its if isinstance(first, self.kind) else self.others)(first, *rest)


class ChoiceType(numba.types.Callable):  # type: ignore[misc]  # numba is not typed
    """Type of a `Choice` in compiled code."""

    def __init__(self, choice: Choice) -> None:
        self.choice = choice
        super().__init__(f"choice({choice.its}, {choice.others})")

    def _meant(self, arguments: Any) -> Any:
        its = arguments[0].instance_class is self.choice.kind
        return numba.types.Dispatcher(self.choice.its if its else self.choice.others)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call; compiles what is called."""
        return self._meant(args).get_call_type(context, args, kws)

    def get_call_signatures(self) -> Any:
        """Signatures known before a call: none."""
        return (), True

    def get_impl_key(self, signature: Any) -> Any:
        """Find the function that a signature means."""
        return self._meant(signature.args).get_impl_key(signature)


register_model(ChoiceType)(models.OpaqueModel)


@typeof_impl.register(Choice)  # type: ignore[untyped-decorator]
def _typeof(choice: Choice, context: Any) -> ChoiceType:
    return ChoiceType(choice)


@lower_constant(ChoiceType)  # type: ignore[untyped-decorator]
def _constant(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


def by_type(kind: type, its: Function, others: Function) -> Function:
    """Return a function: `its` where the first argument is (a view of) a `kind`, and `others` elsewhere."""
    return cast(Function, Choice(kind, its, others))
