"""The worst arms that anybody has found for the project's controllers: what a search for another one begins with, too.

Each JSON file is a list that somebody's attack left: by criterion, one arm for each pose of ``strict`` of then; or, in
``failing``, by test, those that fail with the smallest gain or delay. An arm has the pose [degrees], the deviations of
the 22 parameters in half-widths of Table 1, the direction of the force [rad], the sweep [Hz], the seed of the noise,
the begin t_3 [s] of the chirp where it is not that of the protocol, and the value of the controller attacked, or the
factor of the gain or the additional delay [s]. ``benchmarks/counterexamples.py`` says where each is from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from ...benchmark.protocol import Protocol
from ..member import Member, names
from ..target import Target

LISTS = Path(__file__).parent


def lists() -> dict[str, dict[str, list[dict[str, Any]]]]:
    """The lists by name, and of each the arms by criterion."""
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(LISTS.glob("*.json"))}


def member(arm: Mapping[str, Any], test: str, protocol: Protocol) -> Member:
    """An arm of a list in a ``test`` of ``protocol``."""
    return Member(
        (arm["q_a"][0], arm["q_a"][1]),
        test,
        tuple(zip(names(protocol), arm["deviations"], strict=True)),
        phi_F=arm["phi_F"],
        sweep=(arm["sweep"][0], arm["sweep"][1]),
        seed=arm["seed"],
        t_3=arm.get("t_3"),
    )


def known(target: Target, protocol: Protocol) -> dict[Member, float]:
    """The arms known for a ``target``, each once with its value: those at all poses of one list after the other; of a
    protocol with other parameters or another chirp than the benchmark's, those that it can have."""
    arms = chain.from_iterable(each.get(target.name, ()) for each in lists().values())
    return {member(arm, target.test, protocol): arm["value"] for arm in arms if _fits(arm, protocol)}


def _fits(arm: Mapping[str, Any], protocol: Protocol) -> bool:
    first, last = protocol.disturbance.chirp_starts
    same = sorted(arm["sweep"]) == sorted(protocol.disturbance.chirp_frequencies)
    return same and len(arm["deviations"]) == len(names(protocol)) and first <= arm.get("t_3", first) <= last
