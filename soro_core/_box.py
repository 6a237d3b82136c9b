"""Tables of arrays behind one pointer.

Numba passes a named tuple of forty arrays to a compiled function as four hundred machine words, at every
level of calls, and each access to an array changes its reference count atomically. For an arm of one link
this takes most of the time. So a `Box` holds the tuple, and kernels get a view, which is its address. A view
does not keep what it refers to alive: the caller keeps the box. Boxes of one type can be told apart by their
addresses alone, so that one kernel takes many of them.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numba
from numba import config as numba_config
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AttributeTemplate
from numba.experimental import structref
from numba.experimental.jitclass.base import imp_dtor
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    register_model,
    type_callable,
)

# Sets the cache's folder before anything is compiled.
from soro_core._jit import kernel  # noqa: F401


class BoxType(numba.types.StructRef):  # type: ignore[misc]  # numba is not typed
    """Type of `Box` in compiled code; at the top of a module, so that a cache refers to it by name."""


class ViewType(numba.types.Type):  # type: ignore[misc]
    """Address of a named tuple."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        super().__init__(name=f"view({kind})")

    @property
    def instance_class(self) -> Any:
        """Class of the named tuple, as numba's own tuples have it."""
        return self.kind.instance_class


@register_model(ViewType)
class ViewModel(models.PrimitiveModel):  # type: ignore[misc]
    """A pointer."""

    def __init__(self, manager: Any, view: ViewType) -> None:
        super().__init__(manager, view, manager[view.kind].get_value_type().as_pointer())


@infer_getattr
class ViewAttributes(AttributeTemplate):  # type: ignore[misc]
    """Fields of a view: scalars and arrays as they are, tuples as views again."""

    key = ViewType

    def generic_resolve(self, view: ViewType, name: str) -> Any:
        """Type of the field."""
        if name not in view.kind.fields:
            return None
        kind = view.kind.types[view.kind.fields.index(name)]
        return ViewType(kind) if isinstance(kind, numba.types.BaseNamedTuple) else kind


@lower_getattr_generic(ViewType)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, view: ViewType, pointer: Any, name: str) -> Any:
    index = view.kind.fields.index(name)
    kind = view.kind.types[index]
    place = cgutils.gep_inbounds(builder, pointer, 0, index)
    if isinstance(kind, numba.types.BaseNamedTuple):
        return place
    if not isinstance(kind, numba.types.Array):
        return _constant(builder, place)
    array = context.make_array(kind)(context, builder)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    members = context.data_model_manager[kind]
    for part in ("nitems", "itemsize", "data"):
        setattr(array, part, _constant(builder, place, members.get_field_position(part)))
    for part in ("shape", "strides"):
        position = members.get_field_position(part)
        sizes = [_constant(builder, place, position, i) for i in range(kind.ndim)]
        setattr(array, part, cgutils.pack_array(builder, sizes))
    return array._getvalue()


def _constant(builder: Any, place: Any, *path: int) -> Any:
    """Load what never changes while it can be read: the optimiser need not load it again after a store."""
    value = builder.load(cgutils.gep_inbounds(builder, place, 0, *path) if path else place)
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


@intrinsic  # type: ignore[untyped-decorator]
def _view(typing_context: Any, box: Any) -> Any:
    kind = ViewType(box.field_dict["content"])

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        utils = structref._Utils(context, builder, signature.args[0])
        return utils.get_data_struct(arguments[0])._get_ptr_by_name("content")

    return kind(box), code


@intrinsic  # type: ignore[untyped-decorator]
def _address_of(typing_context: Any, box: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        utils = structref._Utils(context, builder, signature.args[0])
        place = utils.get_data_struct(arguments[0])._get_ptr_by_name("content")
        return builder.ptrtoint(place, context.get_value_type(numba.types.int64))

    return numba.types.int64(box), code


@intrinsic  # type: ignore[untyped-decorator]
def _view_at(typing_context: Any, like: Any, address: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[1], context.get_value_type(signature.return_type))

    return like(like, address), code


if numba_config.DISABLE_JIT:

    class Box(NamedTuple):
        """Keeper of a named tuple."""

        content: Any

    def view(box: Box) -> Any:
        """Return the content."""
        return box.content

    def address_of(box: Box) -> int:
        """Return where `view_at` finds the content."""
        return id(box.content)

    def view_at(like: Any, address: int) -> Any:
        """Return the content at an address, of the same type as `like`."""
        return ctypes.cast(int(address), ctypes.py_object).value

else:

    class Box(structref.StructRefProxy):  # type: ignore[no-redef,misc]
        """Keeper of a named tuple: one argument where Python would unpack sixty arrays a call.

        Only compiled code makes one, so that making one is cached as well.
        """

        # The same as numba's property, which every call would enter.
        _numba_type_ = structref.StructRefProxy._type

    @type_callable(Box)  # type: ignore[untyped-decorator]
    def _box_of(context: Any) -> Any:
        return lambda content: BoxType([("content", content)])

    @lower_builtin(Box, numba.types.Any)  # type: ignore[untyped-decorator]
    def _make(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """As the constructor of `structref`, which is a function of its own with all words of the content."""
        kind, (content,) = signature.return_type, signature.args
        place = context.data_model_manager[kind.get_data_type()].get_value_type()
        size = context.get_constant(numba.types.uintp, context.get_abi_sizeof(place))
        box = context.make_helper(builder, kind)
        box.meminfo = context.nrt.meminfo_alloc_dtor(builder, size, imp_dtor(context, builder.module, kind))
        data = structref._Utils(context, builder, kind).get_data_struct(box._getvalue())
        context.nrt.incref(builder, content, arguments[0])
        data.content = arguments[0]
        return box._getvalue()

    structref.register(BoxType)
    structref.define_boxing(BoxType, Box)
    view, address_of, view_at = _view, _address_of, _view_at
