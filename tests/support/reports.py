"""Documents of all kinds for tests, made by hand: no simulation, and no FMU."""

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from orchestrator.benchmark.certificate import CheckedCase, Difference, Draw, Reference, Score, overall, seeds
from orchestrator.benchmark.draws import Entropy
from orchestrator.benchmark.reliability import Failure, failing, quantile
from orchestrator.benchmark.results import CaseResult, Rules
from orchestrator.benchmark.scorecard import score
from orchestrator.benchmark.spread import Statistic
from orchestrator.conformance.finding import Finding, Severity
from orchestrator.documents.comparison import grouped
from orchestrator.documents.document import Displayable
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.findings import Findings
from orchestrator.documents.head import BoundRecord, ControllerRecord, Head, PlantRecord, SampleTimeRecord, Timing
from orchestrator.documents.recording import About, Recording
from orchestrator.documents.reliability import Reliability
from orchestrator.documents.results import LoopDelay, Results
from orchestrator.documents.robustness import Robustness
from orchestrator.documents.spread import Spread, spread_of
from orchestrator.documents.sweep import Sweep
from orchestrator.documents.tuning import Best, Judged, Tuning
from orchestrator.documents.verification import Verification
from orchestrator.loop.behaviour import ComputingTime
from orchestrator.loop.trajectory import Status
from orchestrator.search.candidates import Range, Trial
from orchestrator.search.findings import (
    ConfigurationFound,
    CriterionSearched,
    Effect,
    Found,
    Margin,
    PeakFound,
    Radius,
    RequirementSearched,
    Step,
)
from plant_fmu.flexible_manipulator.parameters import NOMINAL
from support.results import GRID, PAPER, RULES, TABLE_2, everything, result

CONTROLLER = ControllerRecord(
    file="PID.fmu",
    sha256="c0" * 32,
    fmi_version="2.0",
    generation_tool="by hand",
    parameters={},
    path="my controllers/PID.fmu",
    mapping={},
    connectors={"q_m": BoundRecord(("q_m[1]", "q_m[2]"), "exact"), "e": None, "q_a_ref": None},
)
PLANT = PlantRecord("Plant.fmu", "a1" * 32, "2.0", None, {}, dict(NOMINAL), "python", "a1" * 32)


HEAD = Head(
    benchmark=PAPER.benchmark,
    protocol="paper",
    seed=0,
    controller=CONTROLLER,
    plant=PLANT,
    sample_time=SampleTimeRecord(0.25e-3, True),
    rules=RULES,
    environment={"python": "3.11"},
    timing=Timing(
        start="2026-01-02T00:00:00+00:00",
        wall_time=100.0,
        workers=2,
        simulations=324,
        simulated_time=8000.0,
        simulation_time=50.0,
        computing_time=ComputingTime(2000, 0.3e-6, 0.4e-6, 12e-6),
    ),
)


def unbroken(page: str) -> str:
    """A page without the marks that say where a line may be broken, and where not."""
    return re.sub(r'<wbr>|<span class="word">(.*?)</span>', r"\1", page)


def head_of(**changes: Any) -> Head:
    """The head of results made by hand; ``controller`` and ``plant`` are changed field by field."""
    parts = {name: replace(getattr(HEAD, name), **changes.pop(name, {})) for name in ("controller", "plant")}
    return replace(HEAD, **parts, **changes)


def results_of(cases: Iterable[CaseResult] | None = None, **changes: Any) -> Results:
    """Results with the paper's figures in all cases, or with ``cases``; ``changes`` are fields, also of the head.

    Changes of ``controller`` and ``plant`` are given as mappings.
    """
    found = tuple(everything(TABLE_2) if cases is None else cases)
    own = {name: changes.pop(name) for name in tuple(changes) if name not in Results.__struct_fields__}
    head = head_of(**own)
    values = {
        "schema": Results.SCHEMA,
        "head": head,
        "cases": found,
        "loop_delay": LoopDelay(5e-4, 2.0, 2.5e-4, 1, "samples twice in the first step"),
        **changes,
    }
    card = score(head.rules, found)
    return Results(**{**{name: getattr(card, name) for name in card.__struct_fields__}, **values})


def scaled(factor: float, **changes: Any) -> Results:
    """Results with ``factor`` times the paper's figures in all cases, which is the controller's parameter K."""
    controller = {"parameters": {"K": factor}, **changes.pop("controller", {})}
    values: Mapping[str, float] = {name: factor * value for name, value in TABLE_2.items()}
    return results_of(everything(values, changes.pop("configurations", range(18))), controller=controller, **changes)


def seeded(factor: float, seeds: Iterable[int], **controller: Any) -> Spread:
    """The spread of a controller whose figures are ``factor`` times the paper's, 1 % more per seed."""
    runs = [scaled(factor * (1 + seed / 100), seed=seed) for seed in seeds]
    head = head_of(controller={"parameters": {"K": factor}, **controller}, seed=None)
    return spread_of([run.seed or 0 for run in runs], runs, head)


def searched(factor: float = 1.0, **controller: Any) -> Robustness:
    """What a search found of the controller of :func:`scaled`: A2 fails."""
    return Robustness(
        schema=Robustness.SCHEMA,
        head=head_of(protocol="strict", controller={"parameters": {"K": factor}, **controller}),
        budget=2000,
        simulations=1990,
        spent=1200.5,
        failures=0,
        complete=True,
        cut_short=("radius of V",),
        cost=200.0,
        protocol_cost=180.0,
        criteria={"B5": CriterionSearched(0.02, 0.01, "m", Found(0.025, "simulate <this>")),
                  "B6": CriterionSearched(None, 5.0, "s", Found(None, "simulate that"))},
        requirements={name: RequirementSearched(name == "A1", "limit cycle", 1e-4, 1.0, 5.0, 3, 8, "")
                      for name in ("A1", "A2")},
        margins={"gain_1": Margin(2.5, 20.0), "delay_2": Margin(1.5e-3, 1e-2), "gain_2_down": Margin(None, 0.05)},
        radius=Radius(0.75, None, 1.2),
        configurations=(),
        effects=(),
        path=(),
    )  # fmt: skip


ABOUT = About(
    id="c07.compliant.disturbance",
    roles=(),
    configuration=7,
    q_a=(0.3, -0.9),
    system="compliant",
    test="disturbance",
    duration=26.0,
    force=(300.0, 400.0),
    window=(10.0, 10.5),
    chirp=(0.5, 8.0, 0.0, 15.0),
    u_m0=(1.0, 2.0),
    status=Status.DONE,
    time=26.0,
    message="",
)


def recording(roles: tuple[str, ...], id: str = ABOUT.id, size: float = 8e-3, **changes: Any) -> Recording:
    """A recording of 26 s in which the TCP moves by ``size`` [m] along x at the beginning of the force, and by a tenth
    of it in the chirp."""
    t = np.arange(0, 26, 0.01, dtype=np.float32)
    chirp = np.where((t > 0.5) & (t < 8), 0.1 * np.sin(2 * np.pi * t), 0)
    x = size * np.where(t > 10, np.exp(-2 * np.clip(t - 10, 0, None)), chirp)
    motion = np.column_stack([t, x, 0 * t, x / 2, x / 3]).astype(np.float32)
    torque = np.column_stack([t, np.sin(t), np.cos(t)]).astype(np.float32)
    return Recording(replace(ABOUT, id=id, roles=roles, **changes), motion, torque)


def spread(size: float, system: str) -> Recording:
    """One of the uncertain systems of Figures 11 and 12."""
    return recording(("spread",), f"c07.{system}.disturbance", size, system=system)


RECORDINGS = (
    recording(("B5", "B6", "A3")),
    recording(("B7",), "c08.random_1.disturbance"),
    recording(("example",)),
    spread(8e-3, "compliant"),
    spread(8e-3, "random_1"),
)


def stored(folder: Path, results: Results, recordings: tuple[Recording, ...] = RECORDINGS) -> Evaluation:
    """An evaluation, written to ``folder`` and read back."""
    return Evaluation.load(Evaluation(results, recordings).save(folder))


def hunted(**controller: Any) -> tuple[Robustness, tuple[Recording, ...]]:
    """A search with recordings: A2 fails, more was found than the list has, and two parameters matter."""
    criteria = {
        name: CriterionSearched(1.2 * value, value, RULES.criteria[name].unit, Found(1.5 * value, f"repeat {name}"))
        for name, value in TABLE_2.items()
    }
    requirements = {
        "A1": RequirementSearched(True, "quiet", 3e-6, 1.0, 3.0, 0, 0, "repeat A1"),
        "A2": RequirementSearched(False, "limit cycle", 421e-6, 1.0, 23.7, 6, 8, "repeat A2"),
        "A3": RequirementSearched(False, "limit cycle", 421e-6, 1.0, 23.7, 6, 8, "repeat A3"),
    }
    margins = {
        "gain_1": Margin(None, 20.0),
        "gain_1_down": Margin(0.3, 0.056, 8, 8, "repeat gain_1_down"),
        "gain_2": Margin(2.2, 20.0, 1, 8, "repeat gain_2"),
        "gain_2_down": Margin(None, 0.056),
        "delay_1": Margin(4e-3, 0.01, 8, 8, "repeat delay_1"),
        "delay_2": Margin(1.25e-3, 0.01, 8, 8, "repeat delay_2"),
    }
    stages = ("list", 20), ("V by pose, 1 of 3", 32), ("V by pose, 2 of 3", 44), ("requirements", 60), ("effects", 80)
    found = replace(
        searched(**controller),
        simulations=80,
        cost=170.0,
        protocol_cost=140.7,
        criteria=criteria,
        requirements=requirements,
        margins=margins,
        radius=Radius(0.4, None, 1.2),
        configurations=tuple(
            ConfigurationFound(pose.index, pose.q_a1, pose.q_a2, 140.0, 150.0 + 4 * pose.index) for pose in GRID
        ),
        effects=(
            Effect("f_c[2]", 1.0, "B6", -2.0),
            Effect("m[1]", -1.0, "B6", 0.5),
            Effect("psi[2]", 1.0, "B6", -0.1),
            Effect("f_c[2]", 1.0, "B5", None),
        ),
        peaks=tuple(
            PeakFound(
                pose.index,
                name,
                1e-3 * pose.index,
                {"f_c[2]": (-1.0) ** pose.index, "m[1]": 0.0, "psi[2]": 0.25},
                1.0,
                (0.0, 15.0),
                "repeat",
            )
            for pose in GRID
            for name in ("B5", "B6")
        ),
        path=tuple(
            Step(
                stage,
                count,
                count / 2,
                140.0 + count / 4,
                {"B5": 1e-4 * count, "B6": None if count < 30 else 0.1 * count, "delay_2": 5.0},
            )
            for stage, count in stages
        ),
    )
    nominal = (recording((f"beside {role}",), size=3e-3, system="nominal") for role in ("B5", "A2 2"))
    worst = recording(("B5",), system="worst arm"), recording(("A2 2", "A3 delay_2"), test="delay_2")
    return found, (*worst, *nominal)


def tuned(**controller: Any) -> Tuning:
    """A tuning of 60 trials in which a case was added twice, and the best of which is overfitted."""
    trials = []
    for n in range(60):
        K, T = 20 + (13 * n) % 60, 0.6 + 0.006 * ((29 * n) % 60)
        cost, cycle = 90 + 0.02 * (K - 45) ** 2 + 60 / (1 + n), 0.2 * 1.08**n * (1 + n % 5)
        cut, holds = n % 4 == 3, cycle < 1
        trials.append(
            Trial(n, {"K_p[1]": K, "T<b>": T}, cost + 20 * (not holds), cost, None if cut else cycle, holds, cut)
        )
    trials[17] = replace(trials[17], objective=1000.0, cost=None, cycle=None, message="it <i>died</i>")
    trials[20] = replace(trials[20], objective=91.0, cost=91.0, cycle=0.8, holds=True)
    judged = (Judged(8, 14, 120.0, None, ("A2",), ("repeat <A2>",)), Judged(20, 57, 99.0, 140.0, (), ("repeat B6",)))
    mean = Statistic(99.0, 1.5, 97.0, 102.0)
    return Tuning(
        schema=Tuning.SCHEMA,
        head=head_of(controller=controller),
        objective="tuning",
        sampler="cmaes",
        search_seed=1,
        robust=0,
        vary={"K_p[1]": Range(20.0, 80.0, log=True), "T<b>": Range(0.6, 0.99)},
        trials=tuple(trials),
        judged=judged,
        best=Best(trials[20], 99.0, mean, mean, 150.0, ("A2",)),
        importance={"K_p[1]": 0.8, "T<b>": 0.2},
    )


def swept(*counts: int, **controller: Any) -> Sweep:
    """A sweep in which the first combination alone holds A1 to A3, and the last one has no V."""
    axes = {f"K_{name}": tuple(map(float, range(1, count + 1))) for name, count in enumerate(counts)}
    grid = [dict(zip(axes, chosen, strict=True)) for chosen in itertools.product(*axes.values())]
    trials = [Trial(n, each, 90.0 + n, 90.0 + n, 1.5, not n) for n, each in enumerate(grid)]
    trials[-1] = replace(trials[-1], cost=None, cycle=None, message="=died <i>at noon</i>")
    return Sweep(schema=Sweep.SCHEMA, head=head_of(controller=controller), values=axes, trials=tuple(trials))


def sampled(**controller: Any) -> Reliability:
    """Of five draws, of which the second one breaks A2."""
    names, failure = tuple(RULES.criteria), Failure(1, "delay_2", "limit cycle", "flexible-manipulator simulate x")
    costs = [80.0, 90.0, 100.0, 110.0, 120.0]
    values = {name: [cost / 100.0 * RULES.criteria[name].target for cost in costs] for name in names}
    return Reliability(
        schema=Reliability.SCHEMA,
        head=head_of(controller=controller),
        distribution="box",
        draws=5,
        probability=0.5,
        confidence=0.9,
        requirements={name: failing([failure] if name == "A2" else [], 5, 0.9) for name in ("A1", "A2", "A3")},
        criteria={name: quantile(each, 0.5, 0.9) for name, each in values.items()},
        cost=quantile(costs, 0.5, 0.9),
    )


def verified(
    draws: Sequence[Sequence[CaseResult]],
    strict: Sequence[CaseResult],
    reference: Sequence[CaseResult],
    rules: Rules = RULES,
    **controller: Any,
) -> Verification:
    """A certificate of the cases of several ``draws``, and of those on the list of worst cases, beside a controller
    whose cases are the same in all draws."""
    head = head_of(
        protocol="verification",
        seed=None,
        rules=rules,
        sample_time=SampleTimeRecord(0.25e-3, False),
        controller=controller,
    )
    entropy = Entropy("5" * 64)
    drawn = seeds(entropy, head.controller.sha256, len(draws))

    def scored(each: Sequence[Sequence[CaseResult]]) -> dict[str, Any]:
        found = overall(rules, list(zip(drawn, each, strict=True)))
        costs = [score(rules, cases).cost for cases in each]
        made = tuple(Draw(seed, cost, "0" * 64) for seed, cost in zip(drawn, costs, strict=True))
        return {**{name: getattr(found, name) for name in Score.__struct_fields__}, "draws": made}

    return Verification(
        **scored(draws),
        strict=overall(rules, [(drawn[0], strict)]),
        references={"PID": Reference(**scored([reference] * len(draws)), strict=None, file="PID.fmu")},
        schema=Verification.SCHEMA,
        head=head,
        entropy=entropy,
        repetitions=0,
        code="0" * 64,
        sandbox=True,
        clean=True,
        checked=(CheckedCase("c00.sticky.disturbance", drawn[0], (Difference("TCP", "m", 1e-10, 1e-8),)),),
    )


def documents(**controller: Any) -> dict[str, Displayable]:
    """One of everything that shows itself, by its kind, of a controller with these fields; the text of strangers that
    is not part of it is that of its file."""
    words = controller.get("file", "PID.fmu")
    failed = result(0, "sticky", "gain_1", None, None, Status.ERROR, words)
    cycling = result(4, "slippery", "delay_2", {}, 2e-5)
    some = [failed, cycling, *everything(TABLE_2, [1])]
    found: dict[str, Any] = {
        "evaluation": Evaluation(results_of(some, controller=controller), RECORDINGS),
        "spread": seeded(1.0, range(3), **controller),
        "search": hunted(**controller)[0],
        "tuning": tuned(**controller),
        "sweep": swept(4, **controller),
        "sample": sampled(**controller),
        "verification": verified([everything(TABLE_2), some], some, some, **controller),
    }
    ranked = Evaluation(scaled(0.9, controller=controller))
    found["comparison"] = grouped([(each, None) for each in (ranked, *found.values())])
    found["findings"] = Findings(words, (Finding(Severity.WARNING, words, words, "Mend it."),))
    return found
