"""What the page of the playground is given: the program in WebAssembly, the cases of protocols as numbers, Table 1, and
controllers."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import controller_fmu
from controller_fmu.export.one_program import PLANT
from plant_fmu.flexible_manipulator.parameters import NOMINAL, TABLE_1

from ..benchmark.case import Case
from ..benchmark.cases import NOISE, seed_words
from ..benchmark.protocol import Protocol
from ..codec import plain
from ..views.plot import Axis, Band, Level, Line, Plot, Window, dash, hue
from ..views.units import MILLIMETRE, SECOND, TORQUE
from .flat_case import flat_case

NOMINAL_SYSTEM = "nominal"
"""The system whose parameters a user sets."""

CONTROLLERS: tuple[tuple[str, str, str], ...] = (
    ("DiagonalPID_C", "DiagonalPID_C", ""),
    ("TunedPID", "DiagonalPID_C", "pid_tuned/tuned_pid_gains.json"),
    ("RobustLQG", "RobustLQG", ""),
    ("DitheredLQG_C", "DitheredLQG_C", ""),
    ("RobustLinearLQG", "DitheredLQG_C", "robust_linear/linear_weights.json"),
)
"""Controllers of the page: the name of the FMU, the unit of the program that has its law, and a file in
``controller_fmu`` with the parameters in which the two differ."""

PID = (("K_p", (45.0, 15.0), 4.0), ("K_i", (30.0, 10.0), 4.0), ("K_d", (1.5, 0.5), 4.0), ("z_p", (0.95, 0.95), 1.05))
"""The gains of the PID, their values, and how far a slider goes, as a multiple."""

LINEAR: Mapping[str, Any] = {
    "A": [[0.95, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.95, 0.0], [0.0, 0.0, 0.0, 1.0]],
    "B": [[1.0, 0.0], [0.00025, 0.0], [0.0, 1.0], [0.0, 0.00025]],
    "C": [[-15.0, 30.0, 0.0, 0.0], [0.0, 0.0, -5.0, 10.0]],
    "D": [[345.0, 0.0], [0.0, 115.0]],
}
"""The matrices that a linear controller begins with: the paper's PID, up to rounding."""


def playground_data(
    module: bytes,
    interface: Mapping[str, Any],
    files: Mapping[str, Mapping[str, str]],
    protocols: Mapping[str, tuple[Protocol, Sequence[Case]]],
) -> dict[str, Any]:
    """The page's data: ``files`` are those of the controllers' FMUs, by unit and path; ``protocols`` have their cases
    beside them, by name, and single cases are taken from the first one."""
    main, cases = next(iter(protocols.values()))
    return {
        "module": base64.b64encode(module).decode("ascii"),
        "interface": dict(interface),
        "plant": PLANT,
        "table": _table(main),
        "nominal": dict(NOMINAL),
        "workspace": plain(main.workspace),
        "poses": _poses(cases),
        "noiseWords": [*seed_words(0, -1, NOMINAL_SYSTEM, NOISE)],
        "links": [NOMINAL["l[1]"], NOMINAL["l[2]"]],
        "ratios": [NOMINAL["n[1]"], NOMINAL["n[2]"]],
        "delay": float(main.loop.delay),
        "protocols": {name: _protocol(*given) for name, given in protocols.items()},
        "controllers": [{"name": name, "unit": unit, "values": _values(file)} for name, unit, file in CONTROLLERS],
        "gains": [{"name": name, "values": values, "most": most} for name, values, most in PID],
        "linear": dict(LINEAR),
        "files": _compressed(files),
        "columns": [],
        "texts": [],
    }


def _compressed(files: Mapping[str, Mapping[str, str]]) -> str:
    """The files as JSON, compressed, in base64. Texts that several FMUs have are there once."""
    texts = sorted({text for contents in files.values() for text in contents.values()})
    units = {unit: {path: texts.index(text) for path, text in contents.items()} for unit, contents in files.items()}
    packed = zlib.compress(json.dumps({"units": units, "texts": texts}).encode(), 9)
    return base64.b64encode(packed).decode("ascii")


def _values(file: str) -> dict[str, float]:
    if not file:
        return {}
    text = (Path(controller_fmu.__file__).parent / file).read_text(encoding="utf-8")
    values: dict[str, float] = json.loads(text)["parameters"]
    return values


def _table(protocol: Protocol) -> list[dict[str, Any]]:
    """The rows of Table 1 that are uncertain."""
    return [
        {
            "symbol": row.symbol,
            "unit": row.unit,
            "tolerance": protocol.uncertainty[row.symbol],
            "words": row.description,
        }
        for row in TABLE_1
        if row.symbol in protocol.uncertainty
    ]


def _poses(cases: Sequence[Case]) -> list[dict[str, Any]]:
    poses = {case.configuration.index: case.configuration for case in cases}
    return [
        {
            "index": pose.index,
            "radians": [pose.q_a1, pose.q_a2],
            "degrees": [round(math.degrees(angle), 9) for angle in (pose.q_a1, pose.q_a2)],
        }
        for pose in poses.values()
    ]


def _protocol(protocol: Protocol, cases: Sequence[Case]) -> dict[str, Any]:
    """The cases: of each, in what it differs from the first one; systems once each."""
    flat = [flat_case(protocol, case) for case in cases]
    first, systems, listed = flat[0], [], []
    for case, numbers in zip(cases, flat, strict=True):
        parameters = {name: value for name, value in numbers.plant.items() if not name.startswith("q_a_start")}
        if parameters not in systems:
            systems.append(parameters)
        drawn = case.system.disturbance
        listed.append(
            {
                "id": case.id,
                "pose": case.configuration.index,
                "start": [case.configuration.q_a1, case.configuration.q_a2],
                "system": systems.index(parameters),
                "systemName": case.system.name,
                "test": case.test.name,
                "rules": _other(numbers.rules, first.rules),
                "imperfections": _other(numbers.imperfections, first.imperfections),
                "phi": drawn.phi_F,
            }
        )
    return {
        "rules": first.rules,
        "imperfections": first.imperfections,
        "systems": systems,
        "cases": listed,
        "tests": {
            test.name: {"criteria": test.criteria, "requirements": test.requirements, "axis": test.axis}
            for test in protocol.tests
        },
        "criteria": {name: plain(spec) for name, spec in protocol.criteria.items()},
        "force": protocol.disturbance.force,
    }


def _other(values: Mapping[str, float], first: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if value != first[name]}


def playground_plots(protocol: Protocol) -> tuple[Plot, ...]:
    """Error and torques over time, empty: the page's script puts the curves in."""
    time = Axis("Time", SECOND)
    # As two controllers look in a comparison.
    lines = tuple(
        Line(name, (), (), hue(place), dash(place), above=not place) for place, name in enumerate(("chosen", "beside"))
    )
    rules, settled, target = protocol.disturbance, protocol.settling.error, protocol.criteria["B5"].target
    after = (rules.t_1 - 1.0, rules.t_2 + 5.0)
    shown = (
        Window("Force", after),
        Window("Whole case", (0.0, float(max(test.duration for test in protocol.tests)))),
        Window("Settled?", after, (0.0, 5.0 * settled)),
    )
    error = Plot(
        "error",
        "TCP error",
        time,
        Axis("TCP error", MILLIMETRE, low=0.0),
        lines,
        (Level(settled, "settled"), Level(target, "B5 target")),
        (Band(rules.t_1, rules.t_2, "force"), Band(rules.t_3_range[0], rules.t_4, "chirp")),
        "The distance of the tool from where it began, over time.",
        zoom=True,
        window=shown[0],
        windows=shown,
        group="case",
        height=360,
    )
    return error, *(_torque_plot(axis, time, lines, shown[0]) for axis in (1, 2))


def _torque_plot(axis: int, time: Axis, lines: tuple[Line, ...], window: Window) -> Plot:
    return Plot(
        f"torque-{axis}",
        f"Torque of motor {axis}",
        time,
        Axis("Motor torque", TORQUE),
        lines,
        text=f"The torque that drive {axis} gives, over time.",
        zoom=True,
        window=window,
        group="case",
        height=300,
    )
