"""One name for two kernels: the type of the first argument selects one of them.

Numba's own `overload` would put a function between the caller and the kernel, and numba compiles every such
level with all that lies below it. A choice made while types are inferred costs nothing.
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
    """A pair of compiled functions of equal arguments; use `select_by_type`."""

    def __init__(self, type: type, then: Any, otherwise: Any) -> None:
        self.type, self.then, self.otherwise = type, then, otherwise

    def __call__(self, first: Any, *rest: Any) -> Any:
        """Call the function that the type of `first` selects, without compiling."""
        return (self.then if isinstance(first, self.type) else self.otherwise)(first, *rest)


class ChoiceType(numba.types.Callable):  # type: ignore[misc]  # numba is not typed
    """Type of a `Choice` in compiled code."""

    def __init__(self, choice: Choice) -> None:
        self.choice = choice
        super().__init__(f"choice({choice.then}, {choice.otherwise})")

    def _selected(self, arguments: Any) -> Any:
        selected = arguments[0].instance_class is self.choice.type
        return numba.types.Dispatcher(self.choice.then if selected else self.choice.otherwise)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call; compiles what is called."""
        return self._selected(args).get_call_type(context, args, kws)

    def get_call_signatures(self) -> Any:
        """Signatures known before a call: none."""
        return (), True

    def get_impl_key(self, signature: Any) -> Any:
        """Find the function that a signature means."""
        return self._selected(signature.args).get_impl_key(signature)


register_model(ChoiceType)(models.OpaqueModel)


@typeof_impl.register(Choice)  # type: ignore[untyped-decorator]
def _typeof(choice: Choice, context: Any) -> ChoiceType:
    return ChoiceType(choice)


@lower_constant(ChoiceType)  # type: ignore[untyped-decorator]
def _constant(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


def select_by_type(type: type, then: Function, otherwise: Function) -> Function:
    """Return a function that calls one of two kernels, selected by the type of its first argument.

    Parameters
    ----------
    type : type
        Class of a named tuple; the argument is one, or a view of one (`soro_core._box.view`).
    then : function
        Called for that class.
    otherwise : function
        Called for any other; it takes the same arguments.
    """
    return cast(Function, Choice(type, then, otherwise))
