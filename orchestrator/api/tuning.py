"""Tuning a controller: what is searched, what judges the candidates, and what is found out about the best one."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from ..benchmark.results import Requirement, rules
from ..errors import Crash, FmuError, InputError
from ..execution import store
from ..fmi.variables import variables
from ..reporting.files import prepare_folder, remove, write_text
from ..reporting.recording import BESIDE
from ..reporting.repeat import simulate_command
from ..reporting.robustness import Robustness
from ..reporting.tuning import Best, Judged, Tuning
from ..search.candidates import Range, Trial, check_range
from ..search.proposals import STUDY, Proposals
from . import campaign, document
from .conditions import Conditions
from .controller import Controller
from .evaluating import evaluate, evaluate_seeds
from .robustness import search, sought
from .side_by_side import SideBySide
from .tuner import Judge, OnTrial, Tuner, Verdict

logger = logging.getLogger(__name__)

SEED = 1234
"""What the objective's seed is above the benchmark's: it has other systems, disturbances and noise."""

HELD_OUT = range(1, 9)
"""What the seeds of the draws that the best candidate is tried with are above the objective's."""

SEEDS = range(1, 4)
"""What the seeds of the whole protocol that it is tried with are above the benchmark's."""

BEST = "best.toml"
"""The best candidate's parameters, as a file of parameters."""


def tune(
    goal: Conditions,
    controller: Controller,
    given: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]],
    objective: str | Path,
    strict: str | Path,
    trials: int,
    robust: int,
    sampler: str,
    search_seed: int,
    folder: Path | None,
    on_trial: OnTrial | None,
) -> Tuning:
    """See :meth:`.Benchmark.tune`."""
    begin = time.perf_counter()
    short = replace(goal, protocol=objective, seed=goal.seed + SEED)
    controller, bench, _, cases = short.prepared(controller)
    vary = ranges(given)
    start = values_of(controller, vary)
    if trials < 1:
        raise InputError("At least one trial is needed.", "bad-number")
    if not any(case.test.criteria for case in cases):
        raise InputError(f"The protocol {objective} has no test that V is measured in.", "no-criteria", objective)
    list_of = replace(goal, protocol=strict)
    if robust:
        sought(list_of.rules, list_of.prepared(controller)[3], robust, ())
    begin_at = {name: own.rounded(start[name]) for name, own in vary.items()}
    for name, own in vary.items():
        if not own.low <= start[name] <= own.high:
            logger.warning("%s is %g, out of its range: the search begins at %g.", name, start[name], begin_at[name])
    if folder is not None:
        prepare_folder(folder)
        remove(folder / BEST)  # of another search

    with store.opened(folder) as known:
        proposals = Proposals(vary, begin_at, sampler, search_seed, None if folder is None else folder / STUDY)
        first = short.bench(controller.with_parameters(begin_at))
        if (failure := campaign.rehearse(cases[0], first).failure) is not None:
            raise Crash(failure.result.message)
        tuner = Tuner(
            SideBySide(short.rules, short.execute, known),
            lambda values: short.bench(controller.with_parameters(values)),
            judge(goal, controller, strict, robust, folder),
            proposals,
            list(cases),
            on_trial,
        )
        tuner.search(trials)
        best = tuner.best()
        draws = {seed: replace(short, seed=short.seed + seed).prepared(controller)[3] for seed in HELD_OUT}
        held_out = None if best is None else tuner.held_out(best, draws)
    found = None
    if best is not None and held_out is not None:
        chosen = controller.with_parameters(best.values)
        if folder is not None:
            lines = [f'"{name}" = {value!r}\n' for name, value in best.values.items()]
            write_text(folder / BEST, "".join(["[parameters]\n", *lines]))
        whole = evaluate(goal, chosen, folder=_in(folder, _name(best)), keep_going=True)
        others = [goal.seed + each for each in SEEDS]
        seeds = evaluate_seeds(goal, chosen, others, _in(folder, "seeds"), None, recordings=False)
        listed = evaluate(list_of, chosen, folder=_in(folder, "strict"), recordings=False, keep_going=True)
        broken = tuple(name for name, entry in listed.requirements.items() if entry.passed is False)
        found = Best(best, whole.cost, held_out, seeds.cost, listed.cost, broken, not_judged(listed.requirements))
    return Tuning(
        schema=Tuning.SCHEMA,
        benchmark=goal.rules.benchmark,
        protocol=goal.rules.name,
        objective=str(objective),
        seed=goal.seed,
        sampler=sampler,
        search_seed=search_seed,
        robust=robust,
        vary=vary,
        trials=tuple(tuner.trials),
        judged=tuple(
            Judged(
                number,
                after,
                found.cost,
                found.worst_cost,
                found.broken,
                tuple(line for _, line in found.counterexamples),
            )
            for number, (after, found) in tuner.judged.items()
        ),
        best=found,
        importance=proposals.importance(),
        rules=rules(goal.rules),
        controller=document.controller_record(bench, controller),
        plant=document.plant_record(goal.manipulator, goal.plant_parameters),
        wall_time=time.perf_counter() - begin,
    )


def ranges(given: Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]) -> dict[str, Range]:
    """The ranges that are ``given``, as tuples or as they are; raises :class:`InputError` for what is none."""
    found = {}
    for name, own in given.items():
        if isinstance(own, tuple):
            own = Range(float(own[0]), float(own[1]), log=len(own) > 2 and own[2] == "log")
        found[name] = check_range(name, own)
    if not found:
        raise InputError("Nothing varies: at least one parameter with its range is needed.", "nothing-varies")
    return found


def values_of(controller: Controller, wanted: Iterable[str]) -> dict[str, float]:
    """The parameters of a controller by FMI name: the FMU's own values, or as they are set.

    Raises :class:`InputError` if one that is ``wanted`` is not among them.
    """
    known = variables(controller.archive.description).values()
    own = {each.name: each.start[0] for each in known if each.causality == "parameter" and len(each.start) == 1}
    found = {**own, **controller.setup.parameters}
    if unknown := sorted(set(wanted) - found.keys()):
        message = f"{controller.name} has no parameter {unknown[0]}. It has: {', '.join(found) or 'none'}."
        raise InputError(message, "no-parameter", controller.name, unknown[0], tuple(found))
    return found


def judge(goal: Conditions, controller: Controller, strict: str | Path, robust: int, folder: Path | None) -> Judge:
    """What tries a candidate on the whole protocol and, with ``robust`` simulations, searches for its worst case."""

    def verdict(trial: Trial) -> Verdict:
        candidate, own = controller.with_parameters(trial.values), _in(folder, _name(trial))
        _, _, _, cases = goal.prepared(candidate)
        try:
            evaluation = evaluate(goal, candidate, folder=own, recordings=False, keep_going=True)
        except FmuError:  # at a pose that the objective does not have, so from now on it has it
            return Verdict(None, None, ("refused",), [(cases[0], "")])
        broken = [name for name, entry in evaluation.requirements.items() if entry.passed is False]
        failing = {
            verdict.worst_case: None
            for name in broken
            for verdict in evaluation.requirements[name].axes.values()
            if verdict.passed is False and verdict.worst_case
        }
        named = {case.id: case for case in cases}
        found = [(named[id], simulate_command(evaluation.results, id)) for id in failing]
        broken += [f"{name} not judged" for name in not_judged(evaluation.requirements)]
        if evaluation.cost is None:
            broken.append("V")
        if not robust or broken:  # a search finds nothing that would make it hold
            return Verdict(evaluation.cost, None, tuple(broken), found)
        try:
            answer, shown = search(goal, candidate, robust, protocol=strict, folder=own)
        except (FmuError, Crash):
            return Verdict(evaluation.cost, None, ("refused in strict",), found)
        for each in shown:
            commands = [_command(answer, role) for role in each.roles if not role.startswith(BESIDE)]
            found += [(each.case, command) for command in commands[:1] if command]
        unknown = (f"{name} not judged" for name, entry in answer.requirements.items() if entry.passed is None)
        return Verdict(evaluation.cost, answer.cost, (*answer.broken, *unknown), found)

    return verdict


def not_judged(requirements: Mapping[str, Requirement]) -> tuple[str, ...]:
    """The requirements that the protocol has cases for, but that are not judged."""
    return tuple(name for name, entry in requirements.items() if entry.passed is None and entry.tally.cases)


def _command(answer: Robustness, role: str) -> str:
    """The command that repeats the worst case of a criterion, or of a requirement that fails; else nothing."""
    if role in answer.criteria:
        return answer.criteria[role].worst_case.command
    entry = answer.requirements[role[:2]]
    return entry.command if entry.passed is False else ""


def _name(trial: Trial) -> str:
    """The folder of a candidate that is tried on the whole protocol."""
    return f"trial-{trial.number}"


def _in(folder: Path | None, name: str) -> Path | None:
    return None if folder is None else folder / name
