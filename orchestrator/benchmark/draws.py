"""What the draws of a verification follow from: bits that nobody could know when the controller was published.

Either fresh ones of the verifier's operating system, or a round of drand, a public randomness beacon: every few seconds
a group of organizations signs the number of the round together. Nobody knows the signature before, and everybody can
check it afterwards (https://drand.love). A round counts if it is later than the publication of the controller.
"""

from __future__ import annotations

import functools
import hashlib
import secrets
import sys
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from typing import Any, Literal, NamedTuple, TypeGuard

from ..codec import Malformed, Natural, Struct, from_json
from ..errors import InputError

# Imports inside functions: py_ecc is optional.


class Chain(NamedTuple):
    """One of drand's networks: the time of its round 1, the seconds between two rounds, and its public key on the
    curve's group G2, compressed, as hexadecimal digits."""

    name: str
    genesis: int
    period: int
    public_key: str


QUICKNET = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"

CHAINS = {
    QUICKNET: Chain(
        "quicknet",
        1692803367,
        3,
        "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc22"
        "b0e17e63aaf4bcb5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a",
    )
}
"""The networks that are known, by the hash of their description (https://api.drand.sh/CHAIN/info)."""

SIGNATURE = 96
"""Hexadecimal digits of a signature: a point of G1, compressed."""


class Beacon(Struct):
    """A round of the network ``chain``: its number, its signature as hexadecimal digits, whether that was ``checked``,
    and when the controller was ``published``, as its verifier says (ISO 8601)."""

    chain: str
    round: Natural
    signature: str
    checked: bool
    published: str

    @property
    def time(self) -> datetime:
        """When the round was published."""
        chain = CHAINS[self.chain]
        return datetime.fromtimestamp(chain.genesis, timezone.utc) + timedelta(seconds=chain.period * (self.round - 1))

    @property
    def randomness(self) -> str:
        """The round's random number, 256 bits as hexadecimal digits."""
        return hashlib.sha256(bytes.fromhex(self.signature)).hexdigest()

    @property
    def confirmed(self) -> bool | None:
        """Whether the signature is that of the round; None where that cannot be checked here."""
        try:
            return check(CHAINS[self.chain], self.round, self.signature) or None
        except InputError:
            return False


class Entropy(Struct):
    """256 bits as hexadecimal digits, and where they come from. Those of a ``"round"`` were drawn when all its FMUs
    were there: all of them have the same draws."""

    value: str
    source: Literal["fresh", "beacon", "round"] = "fresh"
    beacon: Beacon | None = None

    @property
    def problem(self) -> str:
        """What contradicts itself; empty if nothing does."""
        if not _is_hexadecimal(self.value, 64):
            return "its entropy has not 256 bits"
        if (self.source == "beacon") != (self.beacon is not None):
            return "its entropy comes from a beacon or not"
        if self.beacon is None:
            return ""
        if self.beacon.chain not in CHAINS or not _is_hexadecimal(self.beacon.signature, SIGNATURE):
            return "its beacon is none that is known"
        if self.beacon.randomness != self.value:
            return "its entropy is not that of its beacon"
        try:
            late = self.beacon.time > moment(self.beacon.published)
        except (InputError, OverflowError):
            return "its beacon has no time"
        if not late:
            return "its beacon is not later than the publication of the controller"
        return "the signature of its beacon is wrong" if self.beacon.confirmed is False else ""


def fresh() -> Entropy:
    """Bits that the operating system has drawn now."""
    # From the operating system, not from a generator with a seed, which could be set.
    return Entropy(secrets.token_hex(32))


def from_beacon(text: str, published: str) -> Entropy:
    """The bits of a round of drand: ``text`` is its JSON, as the network's API gives it, or
    ``drand:CHAIN:ROUND:SIGNATURE``; the controller was ``published`` before (ISO 8601).

    Raises :class:`InputError` for anything else, such as a date, which a controller may know as well; for a signature
    that is wrong; and for a round that is not later.
    """
    told = _told(text)
    chain, number, signature = (told.get(name) for name in ("chain_hash", "round", "signature"))
    chain = QUICKNET if chain is None else chain
    if chain not in CHAINS:
        chains = ", ".join(f"{key} ({network.name})" for key, network in CHAINS.items())
        raise InputError(f"The beacon's chain {chain} is not known. Known: {chains}.", "no-beacon", "", chain)
    if not isinstance(number, int) or not 0 < number < 2**53 or not _is_hexadecimal(signature, SIGNATURE):
        message = f"A round of drand has a number and a signature of {SIGNATURE} hexadecimal digits."
        raise InputError(message, "no-beacon", "", text[:100])
    when = moment(published)
    checked = check(CHAINS[chain], number, signature)
    beacon = Beacon(chain, number, signature, checked, when.isoformat())
    # The API gives it beside the signature. It follows from that, so another one is a slip or a forgery.
    if told.get("randomness") not in (None, beacon.randomness):
        raise InputError("The beacon's randomness is not the SHA-256 of its signature.", "no-beacon")
    if beacon.time <= when:
        message = f"Round {number} of drand was published at {beacon.time.isoformat()}, not after the controller, "
        message += f"{beacon.published}: it may have been known when the controller was made."
        raise InputError(message, "early-beacon", "", number)
    return Entropy(beacon.randomness, "beacon", beacon)


def _told(text: str) -> Mapping[str, Any]:
    words = text.strip().split(":")
    if words[0] == "drand" and len(words) == 4 and words[2].isdecimal():
        return {"chain_hash": words[1], "round": int(words[2]), "signature": words[3]}
    try:
        return from_json(text, dict[str, Any])
    except Malformed:
        message = "Draws follow from fresh entropy, or from a round of the public beacon drand: its JSON, or "
        message += "drand:CHAIN:ROUND:SIGNATURE. A date or another text may be known to the controller."
        raise InputError(message, "no-beacon", "", text[:100]) from None


def moment(text: str) -> datetime:
    """An ISO 8601 time; without a zone it is taken as UTC. Raises :class:`InputError`."""
    try:
        time = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        message = f"{text!r} is no time, such as 2027-01-31T12:00:00Z."
        raise InputError(message, "no-time", "", text) from None
    return time if time.tzinfo else time.replace(tzinfo=timezone.utc)


@functools.cache
def check(chain: Chain, number: int, signature: str) -> bool:
    """Whether the signature of a round has been checked, which needs the package py_ecc (extra ``beacon``).

    It is a point S of G1 with e(S, g_2) = e(H(m), P): BLS on the curve BLS12-381, with m the SHA-256 of the round's
    number in eight bytes and H as in RFC 9380. Raises :class:`InputError` if it is wrong.
    """
    limit = sys.getrecursionlimit()
    try:
        from py_ecc.bls.g2_primitives import subgroup_check
        from py_ecc.bls.hash_to_curve import hash_to_G1
        from py_ecc.bls.point_compression import decompress_G1, decompress_G2
        from py_ecc.optimized_bls12_381 import G2, pairing
    except ImportError:
        return False
    finally:
        # The import raises it to 100,000 for the whole process, in which a JSON file of so many brackets then
        # overflowed the stack. What is used of the package has loops.
        sys.setrecursionlimit(limit)
    # The scheme bls-unchained-g1-rfc9380: the message is the number
    # alone, so a round can be checked without the one before.
    tag = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_"
    halves = chain.public_key[:96], chain.public_key[96:]
    key = decompress_G2((int(halves[0], 16), int(halves[1], 16)))
    hashed = hash_to_G1(hashlib.sha256(number.to_bytes(8, "big")).digest(), tag, hashlib.sha256)
    try:
        point = decompress_G1(int(signature, 16))
        # A point outside the subgroup may pass the pairing, and is no signature.
        good = subgroup_check(point) and pairing(G2, point) == pairing(key, hashed)
    except (ValueError, AssertionError):
        good = False
    if not good:
        raise InputError(f"The signature of round {number} of drand's {chain.name} is wrong.", "wrong-signature")
    return True


def _is_hexadecimal(text: object, digits: int) -> TypeGuard[str]:
    return isinstance(text, str) and len(text) == digits and all(digit in "0123456789abcdef" for digit in text)
