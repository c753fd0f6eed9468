"""The one codec: typed data to bytes and back, validated on the way in.

It serves ``results.json``, the store, protocol files, and the messages of worker processes and cluster workers. Types
are msgspec structs and dataclasses; decoding checks every field against its annotation, so data from a stranger are
either of the type asked for or an error.
"""

from __future__ import annotations

import math
import threading
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import msgspec
import numpy as np

from .exact_time import seconds

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_):
        """What tells a type checker about classes does nothing when they run."""
        return lambda cls: cls


T = TypeVar("T")

MAX_FLOAT = 1.7976931348623157e308
Finite = Annotated[float, msgspec.Meta(ge=-MAX_FLOAT, le=MAX_FLOAT)]
"""A number that is neither NaN nor infinite."""
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=MAX_FLOAT)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=MAX_FLOAT)]
Natural = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
Scalar = bool | int | Finite | str
"""The value of a parameter or an input of an FMU, whose type it has."""

DTYPES = ("<f8", "<f4")
"""Element types of arrays that are sent."""


@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Struct(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all documents and messages: frozen, with exactly the fields it declares."""


class Malformed(ValueError):
    """Data are not of the expected type."""


_known: set[Any] = set()
_looking = threading.Lock()


def _known_type(kind: type[T]) -> type[T]:
    """``kind``, after msgspec has looked up its fields, which it does once for each type.

    In msgspec 0.22, a second thread that uses the type meanwhile crashes the process. Here it waits.
    """
    if kind not in _known:
        with _looking:
            msgspec.msgpack.Decoder(kind)
            _known.add(kind)
    return kind


def pack(value: Any) -> bytes:
    """``value`` as MessagePack, for messages: fast, and with arrays."""
    return msgspec.msgpack.encode(value, enc_hook=_to_plain)


def unpack(data: bytes, kind: type[T]) -> T:
    """The inverse of :func:`pack`; raises :class:`Malformed` for anything that is not a ``kind``."""
    try:
        return msgspec.msgpack.decode(data, type=_known_type(kind), dec_hook=_from_plain)
    except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
        raise Malformed(str(problem)) from None


def to_json(value: Any, indent: int | None = 1) -> str:
    """``value`` as JSON, for files. It must not hold numbers that are not finite, which JSON cannot express."""
    text = msgspec.json.encode(value, enc_hook=_to_plain)
    return (msgspec.json.format(text, indent=indent) if indent is not None else text).decode()


def from_json(text: bytes | str, kind: type[T]) -> T:
    """The inverse of :func:`to_json`; raises :class:`Malformed`."""
    try:
        return msgspec.json.decode(text, type=_known_type(kind), dec_hook=_from_plain)
    except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
        raise Malformed(str(problem)) from None


def convert(plain: Any, kind: type[T]) -> T:
    """Plain dictionaries and lists, such as a TOML file's, as a ``kind``; raises :class:`Malformed`."""
    try:
        return msgspec.convert(plain, _known_type(kind), dec_hook=_from_plain)
    except (msgspec.ValidationError, ValueError, RecursionError) as problem:
        raise Malformed(str(problem)) from None


def plain(value: Any) -> Any:
    """``value`` as dictionaries, lists and scalars."""
    return msgspec.to_builtins(value, enc_hook=_to_plain)


def json_schema(kind: type) -> dict[str, Any]:
    """The JSON Schema of a type."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(kind)}


def _to_plain(value: Any) -> Any:
    if isinstance(value, Fraction):
        return str(value)
    if isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return [little.dtype.str, list(little.shape), little.tobytes()]
    raise NotImplementedError(f"{type(value).__name__} cannot be part of a message")


def _from_plain(kind: type, value: Any) -> Any:
    if kind is Fraction:
        return seconds(value)
    if kind is np.ndarray:
        dtype, shape, data = value
        sizes = isinstance(shape, list) and all(isinstance(size, int) and 0 <= size <= 2**40 for size in shape)
        # An object dtype would be pickled data, which can run anything.
        if dtype not in DTYPES or not sizes or not isinstance(data, bytes):
            raise ValueError("not an array")
        # Before NumPy sees it: frombuffer and reshape would raise others, or take memory for what is not there.
        if math.prod(shape) * np.dtype(dtype).itemsize != len(data):
            raise ValueError("an array whose size is not that of its data")
        return np.frombuffer(data, dtype).reshape(shape)
    raise NotImplementedError(kind)
