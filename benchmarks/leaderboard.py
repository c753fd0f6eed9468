"""The README's leaderboard and the tables on the controllers' pages, from evaluations of these controllers.

    python benchmarks/leaderboard.py                evaluate all with both builds of the plant and search for their
                                                    worst cases (a night: one took 41 minutes on two cores with a
                                                    budget of 15,000), keep the figures, write the tables
    python benchmarks/leaderboard.py DiagonalPID    evaluate one; the figures of the others stay
    python benchmarks/leaderboard.py --search       after a change of search or verdicts: evaluate and search with the
                                                    native plant; spread over the seeds and computing time stay
                                                    (a little less)
    python benchmarks/leaderboard.py --evaluate     after a change of verdicts or of a protocol's cases: evaluate on
                                                    ``paper`` and ``strict`` with the native plant; the rest stays, and
                                                    is shown with the version that found it (ten minutes)
    python benchmarks/leaderboard.py --same         after a change of FMUs or code that must not move a number: evaluate
                                                    all on ``paper``; where all cases are the same to the last bit,
                                                    keep the figures with the hashes of the new FMUs, else fail
    python benchmarks/leaderboard.py --table        write the tables anew from the figures that are kept and from the
                                                    certificates in submissions/ (docs/publishing.md)

The figures are kept in docs/leaderboard.json, each with the hashes of controller, plant, code and all case results. The
tables are made from them and from docs/claims.json, which has what others found beyond the searches (claims.py), and
what a former search of the same controller found beyond the present one, if its command still gives it.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import build_fmus  # noqa: E402
from benchmarks.claims import OWN, Claim, Figures, add, counting, name_of  # noqa: E402
from benchmarks.counterexamples import SEEDS as OTHER_SEEDS  # noqa: E402
from benchmarks.counterexamples import fails, named_in, repeated  # noqa: E402
from benchmarks.lanes import InLanes  # noqa: E402
from benchmarks.leaderboard_tables import PAGES, PICTURE, draw, pages  # noqa: E402
from orchestrator import Benchmark, Controller, Robustness  # noqa: E402
from orchestrator.benchmark.scorecard import kind  # noqa: E402
from orchestrator.cache import PACKAGE, source_hash  # noqa: E402
from orchestrator.codec import to_json  # noqa: E402
from orchestrator.documents.results import Results  # noqa: E402
from orchestrator.pairing.controller import in_c  # noqa: E402
from orchestrator.search.findings import BUDGET  # noqa: E402
from orchestrator.study.evaluate import EvaluationStudy, SpreadStudy  # noqa: E402
from orchestrator.study.requests import Requests, inside  # noqa: E402
from orchestrator.study.worst_case import RobustnessStudy  # noqa: E402

FIGURES = ROOT / "docs" / "leaderboard.json"
FMUS = Path("build", "fmus")
"""Below the folder of the project, in which the commands are run."""

SEARCHED = ("B5", "B6", "B7")
STARTS, BUDGETS, AGREEMENT = 3, (3 * BUDGET, 10 * BUDGET), 0.03
"""Independent starts of the search for V, the budgets that they share, and the spread of V over the starts, relative to
the largest: the first budget is taken at which that is no larger, else the last. A controller that meets target and
requirements in the first search is searched with the last budget, too, since that is a claim about all systems."""

SEEDS = range(5)
"""Of the spread on a controller's page."""

TWINS: dict[str, tuple[str, dict[str, float]]] = {
    "DiagonalPID": ("DiagonalPID_C", {}),
    "TunedPID": ("DiagonalPID_C", {}),
    "DitheredLQG": ("DitheredLQG_C", {}),
    "ManipulatorLQG": ("DitheredLQG_C", {"amplitude[1]": 0.0, "amplitude[2]": 0.0}),
}
"""The controller in C that is searched in the place of one in Python, and its parameters beside that one's own."""

CODE = ("fmi", "loop", "benchmark", "jit.py")
"""What of the package computes the figures."""


EVALUATION = EvaluationStudy(recordings=False)


def evaluate(
    name: str, folder: Path, before: Figures | None = None, budgets: Sequence[int] = BUDGETS
) -> dict[str, Any]:
    """The figures of one controller: on ``paper``, with both builds of the plant; on ``strict``; the worst found; over
    the seeds. With the figures from ``before``, with the native plant alone, and with their seeds and time per step."""
    return InLanes().engine(folder / name).run(studied(name, folder / name, before, budgets))


def studied(name: str, folder: Path, before: Figures | None, budgets: Sequence[int]) -> Requests[dict[str, Any]]:
    """The study of it, made of others, whose files are in ``folder``."""
    searched, strict = searched_as(name), Benchmark("strict")
    measured = yield from _evaluated(name, folder, ("native", "python") if before is None else ("native",))
    found = yield from _agreed(strict, searched, budgets)
    if before is None:
        seeds = yield from inside("seeds", SpreadStudy(SEEDS, EVALUATION).ask(Benchmark(), searched))
        over = {"count": len(SEEDS), "cost": seeds.cost, "requirements": seeds.requirements}
        spread = json.loads(to_json(over))
    else:
        spread = before["seeds"]
    return {
        **measured,
        "robustness": _found(found),
        "seeds": spread,
        "computing_time": measured["computing_time"] if before is None else before["computing_time"],
    }


def evaluated_anew(figures: Figures, folder: Path) -> dict[str, Any]:
    """The ``figures`` of a controller with those on ``paper`` and ``strict`` as they are now; what was searched for
    stays, with the version of the benchmark that it is of."""
    name = name_of(figures)
    measured = InLanes().engine(folder / name).run(_evaluated(name, folder / name, ("native",)))
    found = {"benchmark": figures["benchmark"], **figures["robustness"]}
    return {**measured, **_kept(figures, "seeds", "computing_time"), "robustness": found}


def _evaluated(name: str, folder: Path, plants: Sequence[str]) -> Requests[dict[str, Any]]:
    """The figures of a controller on ``paper``, with these builds of the plant, and on ``strict``."""
    controller, hashes = built(name), {}
    for plant in plants:
        run = yield from inside(plant, EVALUATION.ask(Benchmark(plant=plant), controller))
        hashes[plant] = hashlib.sha256((folder / plant / "cases.csv").read_bytes()).hexdigest()
    assert len(set(hashes.values())) == 1, "the native plant gives other results"
    results = run.results
    listed = yield from inside("strict", EVALUATION.ask(Benchmark("strict"), searched_as(name)))
    return {
        "guid": controller.archive.description.guid,
        "plant": _plant(),
        "code": source_hash(PACKAGE / part for part in CODE),
        "cases": hashes["native"],
        "controller": _part(results.controller, "file", "sha256", "fmi_version", "generation_tool"),
        **_part(results, "benchmark", "protocol", "seed"),
        **_scorecard(results),
        "strict": _scorecard(listed.results),
        "computing_time": json.loads(to_json(results.timing.computing_time)),
    }


def _agreed(strict: Benchmark, searched: Controller, budgets: Sequence[int]) -> Requests[Robustness]:
    """A search with the first of the budgets at which independent starts agree and a failure or a V above its target
    is found, or the last."""
    for budget in budgets:
        # Without what others found: it must show whether it finds that, too.
        study = RobustnessStudy(budget, restarts=STARTS, known=False)
        found = yield from inside("strict", study.ask(strict, searched))
        if agree(found.starts) and not meets(_found(found)):
            break
    return found


def found_before(before: Figures, now: Figures) -> list[Claim]:
    """What the search ``before`` found beyond that of ``now``, of the same controller, as claims: what the commands
    give now. What no longer fails, or not by as much, is left out.

    Searches are lower bounds. The search of version 4 with a budget of 15,000 missed margins of `RobustLinearLQG` that
    version 3's had found with 9,000.
    """
    if before["cases"] != now["cases"]:
        return []  # of another controller
    search = before["robustness"]
    by = f"{OWN}, in its search of {search['benchmark']} with a budget of {search['budget']:,}"
    entries = {**search["worst_case"], **search["margins"], **search["requirements"]}
    found = (
        _repeated(now, figure, entry, by)
        for figure, entry in entries.items()
        if entry["command"] and not figure.endswith("_down") and entry.get("passed") is not True
    )
    return [claim for claim in found if claim is not None and counting(now, [claim])]


def _repeated(now: Figures, figure: str, entry: Mapping[str, Any], by: str) -> Claim | None:
    """The claim that the command of ``entry`` gives in this version; none if it is no failure here."""
    protocol = Benchmark("strict").rules
    claim = Claim(name_of(now), now["cases"], figure, by, datetime.date.today().isoformat(), entry.get("value"))
    if not counting(now, [claim]):
        return None  # nothing to simulate for
    file = named_in(entry["command"], FMUS)
    result, *others = (repeated(entry["command"], file, seed) for seed in (None, *OTHER_SEEDS))
    measured = result.measurements
    motion = {
        "command": entry["command"],
        "limit_cycle": measured.limit_cycle,
        "frequency": measured.limit_cycle_frequency,
        "rest_error": measured.rest_error,
    }
    if figure in SEARCHED:
        return replace(claim, value=getattr(measured, figure), **motion)
    if not fails(result, protocol):
        return None
    failing = sum(fails(each, protocol) for each in others)
    return replace(
        claim, kind=kind(result, protocol.stability), seeds_failed=failing, seeds_tried=len(others), **motion
    )


def meets(found: Mapping[str, Any]) -> bool:
    """Whether V stays below its target and A1 to A3 hold in all systems within the tolerances that a search simulated,
    by what is kept of it."""
    held, radius = all(entry["passed"] for entry in found["requirements"].values()), found["radius"]
    return held and radius is not None and (radius["cost"] is None or radius["cost"] > 1.0)


def agree(starts: Sequence[float | None]) -> bool:
    """Whether V of all starts, None for one that is unstable, lies within the share AGREEMENT of the largest."""
    known = [each for each in starts if each is not None]
    return len(known) == len(starts) and max(known) - min(known) <= AGREEMENT * max(known)


def same(figures: Figures, folder: Path) -> dict[str, Any]:
    """The ``figures`` of a controller with the hashes of its FMU, the plant and the code as they are now.

    Raises :class:`SystemExit` if a case of ``paper`` differs in a bit from that of the FMUs they were measured with.
    """
    name = name_of(figures)
    controller = built(name)
    results = InLanes().evaluate(controller, folder=folder / "same" / name, recordings=False).results
    cases = hashlib.sha256((folder / "same" / name / "cases.csv").read_bytes()).hexdigest()
    if cases != figures["cases"] or results.cost != figures["cost"]:
        raise SystemExit(f"{name}: not the results that are kept; evaluate it anew")
    print(f"{name}: all {len(results.cases)} cases of paper are the same to the last bit", flush=True)
    own = _part(results.controller, "file", "sha256", "fmi_version", "generation_tool")
    code = source_hash(PACKAGE / part for part in CODE)
    hashes = {"guid": controller.archive.description.guid, "plant": _plant(), "code": code}
    return {**figures, **hashes, "controller": own}


def _plant() -> str:
    """SHA-256 of the plant in Python, whose numbers the native one has."""
    return hashlib.sha256(build_fmus.build("FlexibleManipulator", FMUS).read_bytes()).hexdigest()


def built(name: str) -> Controller:
    """One of the project's controllers, in the place that the commands in the tables name."""
    build_fmus.build(name, FMUS)
    return Controller(FMUS / f"{name}.fmu")


def searched_as(name: str) -> Controller:
    """The controller in C that takes the place of one in Python on ``strict``, in the search and over the seeds, since
    it is several times faster: the PIDs' torques are the same to the last bit (tests/test_c_controllers.py), those of
    the LQGs up to rounding (benchmarks/lqg_twins.py)."""
    if name not in TWINS:
        return built(name)
    twin, beside = TWINS[name]
    return in_c(built(name), built(twin)).with_parameters(beside)


def _scorecard(results: Results) -> dict[str, Any]:
    return {
        "cost": results.cost,
        "criteria": {key: _part(entry, "value", "unit", "share") for key, entry in results.criteria.items()},
        "stability": {key: _part(entry, "passed") for key, entry in results.stability.items()},
    }


def _found(found: Robustness) -> dict[str, Any]:
    """What the tables show of a search."""
    kept: dict[str, Any] = json.loads(to_json(found))
    worst = {
        name: {**kept["criteria"][name]["worst_case"], "unit": kept["criteria"][name]["unit"]} for name in SEARCHED
    }
    parts = {
        name: kept[name] for name in ("cost", "starts", "budget", "simulations", "requirements", "margins", "radius")
    }
    means = {name: _part(found.criteria[name], "value", "unit") for name in SEARCHED}
    head = {"benchmark": found.benchmark, "seed": found.head.seed}
    return {**head, **parts, "criteria": means, "worst_case": worst}


def _part(of: object, *names: str) -> dict[str, Any]:
    return {name: getattr(of, name) for name in names}


def _kept(figures: Figures, *names: str) -> dict[str, Any]:
    return {name: figures[name] for name in names}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Make the README's leaderboard.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"controllers to evaluate: {', '.join(PAGES)}")
    parser.add_argument("--table", action="store_true", help="only write the tables from the figures that are kept")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "leaderboard", help="folder of the evaluations")
    parser.add_argument("--search", action="store_true", help="evaluate and search with the native plant, not the rest")
    parser.add_argument("--budget", type=int, help="of the search; without it, the first at which the starts agree")
    parser.add_argument(
        "--evaluate", action="store_true", help="evaluate with the native plant, and search for nothing"
    )
    parser.add_argument("--same", action="store_true", help="only check that the FMUs give the cases that are kept")
    options = parser.parse_args()
    os.chdir(ROOT)
    kept = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else []
    if options.same or options.evaluate:
        chosen, renew = options.names or PAGES, same if options.same else evaluated_anew
        kept = [renew(each, options.runs) if name_of(each) in chosen else each for each in kept]
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    for name in () if options.table or options.same or options.evaluate else options.names or PAGES:
        before = next((each for each in kept if name_of(each) == name), None)
        budgets = (options.budget,) if options.budget else BUDGETS
        new = evaluate(name, options.runs, before if options.search else None, budgets)
        add(found_before(before, new) if before else ())
        kept = [each for each in kept if name_of(each) != name] + [new]
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    for file, text in pages(kept).items():
        file.write_text(text, encoding="utf-8")
    draw(kept, PICTURE)


if __name__ == "__main__":
    main()
