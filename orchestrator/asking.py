"""Computations that ask for what they need, as generators: somebody else answers, and owns all effects.

Such a generator yields requests and is sent the answers; its return value is the result. What goes wrong in answering
is raised where it has asked. It can be tried with any function that answers, and be part of another one.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, TypeVar

Request = TypeVar("Request")
Other = TypeVar("Other")
T = TypeVar("T")


def answered(asking: Generator[Request, Any, T], answer: Callable[[Request], Any]) -> T:
    """The result of ``asking`` if ``answer(request)`` answers each of its requests."""
    try:
        request = next(asking)
        while True:
            try:
                reply = answer(request)
            except BaseException as problem:
                request = asking.throw(problem)
            else:
                request = asking.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result


def translated(
    asking: Generator[Request, Any, T], translate: Callable[[Request], Generator[Other, Any, Any]]
) -> Generator[Other, Any, T]:
    """The same with requests of another kind: ``translate(request)`` asks for what answers it."""
    try:
        request = next(asking)
        while True:
            try:
                reply = yield from translate(request)
            except BaseException as problem:
                request = asking.throw(problem)
            else:
                request = asking.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result
