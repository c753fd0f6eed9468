"""Independent draws of everything that a case leaves open: arm, pose, direction of the force, sweep and begin of the
chirp, noise."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

from ..benchmark.protocol import Protocol
from ..benchmark.reliability import Distribution
from ..loop.random_streams import stable_stream
from .member import Member, names

PURPOSE = zlib.crc32(b"reliability")
"""A word of the seeds that no other draws use."""

SEEDS = 2**31
"""Number of the seeds that a realization of the noise is chosen from."""


def members(protocol: Protocol, distribution: Distribution, seed: int, number: int) -> tuple[Member, ...]:
    """Draw ``number`` of a sample: a member for each test of the protocol that does not repeat another with other
    noise. It depends on its number, the seed and the distribution alone, so that a sample can grow."""
    stream = stable_stream((seed, number, PURPOSE, zlib.crc32(distribution.encode())))
    uniform = stream.uniform(-1.0, 1.0, len(names(protocol))).tolist()
    deviations = [math.copysign(1.0, value) for value in uniform] if distribution == "corners" else uniform
    workspace = protocol.workspace
    first, second = stream.uniform(*workspace.q_a1_deg), stream.uniform(*workspace.q_a2_deg)
    phi_F, upward = stream.uniform(0.0, 2.0 * math.pi), stream.uniform() < 0.5
    low, high = protocol.disturbance.chirp_frequencies
    drawn = Member(
        q_a=(float(first), float(second)),
        test="",
        deviations=tuple(zip(names(protocol), deviations, strict=True)),
        seed=int(stream.randint(SEEDS)),
    )
    # Last, so that all else of a draw is what it was before t_3 was drawn (Table 1: 0.5 s, more or less 0.5 s).
    t_3 = float(stream.uniform(*protocol.disturbance.chirp_starts))
    disturbed = replace(drawn, phi_F=float(phi_F), sweep=(low, high) if upward else (high, low), t_3=t_3)
    tests = [test for test in protocol.tests if not test.repeats]
    return tuple(replace(disturbed if test.disturbed else drawn, test=test.name) for test in tests)
