"""Errors that are raised on purpose."""

from collections.abc import Callable
from typing import Any

import pytest

from orchestrator.errors import InputError


def refusal(function: Callable[..., Any], *arguments: Any, kind: type[Exception] = InputError, **keywords: Any) -> Any:
    """The error of this ``kind`` that ``function`` raises."""
    with pytest.raises(kind) as caught:
        function(*arguments, **keywords)
    return caught.value
