"""Certificates of verifications, read from files."""

from __future__ import annotations

from pathlib import Path

from ..benchmark.certificate import Verification, check
from ..codec import Malformed, from_json
from ..errors import InputError


def load_certificate(file: Path) -> Verification:
    """The certificate in ``file``.

    Raises :class:`InputError` if there is none, a field is not what it should be, or its parts contradict each other.
    """
    try:
        found = from_json(file.read_bytes(), Verification)
        check(found)
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.", "no-file", file) from problem
    except Malformed as problem:
        raise InputError(f"{file} is not a certificate: {problem}.", "damaged", file) from None
    return found
