"""One thing found out about an FMU."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Severity(str, Enum):
    """How much a finding matters: an ERROR keeps the controller from being evaluated."""

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True)
class Finding:
    """``subject`` names what was looked at, ``text`` what was found, ``remedy`` what to do about it.

    ``what``, ``value`` and ``nearest`` are those of an :class:`~orchestrator.errors.InputError` that was found.
    """

    severity: Severity
    subject: str
    text: str
    remedy: str = ""
    what: str = ""
    value: str = ""
    nearest: tuple[str, ...] = ()
