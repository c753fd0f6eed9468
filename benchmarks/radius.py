"""What robustness costs: V on the strict list against the factor on all tolerances of Table 1, for several controllers.

    python benchmarks/radius.py                          docs/radius.json and docs/pictures/radius.png, some five
                                                        minutes; needs a C compiler
    python benchmarks/radius.py --picture                the picture anew

The list is that of the protocol ``strict`` at 13 of its 25 poses, tests of A1 and A2 left out. What is drawn hollow
fails A1, A2 or A3 at that factor in a search (docs/leaderboard.json); at a factor of 0 there is the nominal arm alone.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.protocol import FILES  # noqa: E402
from orchestrator.pairing.controller import IN_C, in_c, reference  # noqa: E402

DATA, PICTURE, LEADERBOARD = (
    ROOT / "docs" / name for name in ("radius.json", "pictures/radius.png", "leaderboard.json")
)
WORK = ROOT / "runs" / "radius"

CONTROLLERS = ("TunedPID", "ManipulatorLQG", "RobustLinearLQG", "DitheredLQG", "RobustLQG")
SCALES = (0.0, 0.5, 0.8, 1.0, 1.2)
GRID = re.compile(r"q_a1_points = 6\nq_a2_points = 3")


def protocol(scale: float) -> str:
    """The strict list with all half-widths of Table 1 multiplied by ``scale``."""
    head, *tests = FILES.joinpath("strict.toml").read_text(encoding="utf-8").split("[[tests]]")
    head, found = GRID.subn("q_a1_points = 3\nq_a2_points = 2", head.replace('name = "strict"', 'name = "radius"'))
    assert found == 1
    widths = Benchmark("strict").rules.uncertainty
    scaled = "".join(f"{name} = {scale * width}\n" for name, width in widths.items())
    return f"{head}\n[uncertainty]\n{scaled}\n" + "".join(f"[[tests]]{test}" for test in tests if "criteria" in test)


def compiled(name: str) -> Controller:
    """A controller in C, where it is the same up to rounding and several times faster."""
    if name == "ManipulatorLQG":  # the dithered one without its dither
        twin = in_c(Controller.built_in(name), Controller.built_in("DitheredLQG_C"))
        return twin.with_parameters({"amplitude[1]": 0.0, "amplitude[2]": 0.0})
    return reference(name) if name in IN_C else Controller.built_in(name)


def cost(name: str, scale: float) -> float | None:
    """V of a controller at a factor on the tolerances."""
    folder = WORK / name
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"radius-{scale:g}.toml"
    file.write_text(protocol(scale), encoding="utf-8")
    return Benchmark(file).evaluate(compiled(name), folder=folder / f"{scale:g}", recordings=False).cost


def draw(found: dict[str, dict[str, float | None]]) -> None:
    """V against the factor."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    radii = {
        Path(each["controller"]["file"]).stem: each["robustness"]["radius"]["stability"]
        for each in json.loads(LEADERBOARD.read_text(encoding="utf-8"))
    }
    if missing := found.keys() - radii.keys():
        sys.exit(f"not searched yet (benchmarks/leaderboard.py): {', '.join(sorted(missing))}")
    figure, panel = plt.subplots(figsize=(6.3, 3.8), layout="constrained")
    panel.axhline(100.0, color="0.6", lw=0.8, ls="--")
    panel.axvline(1.0, color="0.6", lw=0.8, ls="--")
    for name, costs in found.items():
        known = {float(scale): value for scale, value in costs.items() if value is not None}
        (line,) = panel.plot(list(known), list(known.values()), "-", lw=1.2, label=name)
        for scale, value in known.items():
            fails = radii.get(name) is not None and scale >= radii[name]
            panel.plot(scale, value, "o", ms=5, color=line.get_color(), mfc="white" if fails else line.get_color())
    panel.set_xlabel(
        "factor on all tolerances of Table 1 (hollow: a system was found that breaks A1, A2 or A3)", fontsize=8
    )
    panel.set_ylabel("V, 13 poses of strict", fontsize=8)
    panel.set_ylim(bottom=0.0)
    panel.legend(fontsize=8)
    figure.savefig(PICTURE, dpi=150)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", action="store_true", help="draw what is in docs/radius.json")
    given = parser.parse_args()
    if not given.picture:
        found = {name: {f"{scale:g}": cost(name, scale) for scale in SCALES} for name in CONTROLLERS}
        DATA.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    draw(json.loads(DATA.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
