"""The tables of docs/protocol.md, from the types of a protocol file.

    python benchmarks/protocol_reference.py             writes them between their marks

Names, allowed values and defaults are those of the types in orchestrator/benchmark/protocol.py and case.py, and the
examples those of the protocol ``paper``. Only the meanings are written here; a field without one is a KeyError.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.marked_tables import with_table  # noqa: E402
from orchestrator.benchmark import protocol as types  # noqa: E402
from orchestrator.benchmark.case import Again, Disturbance, Test  # noqa: E402
from orchestrator.codec import MAX_FLOAT, plain  # noqa: E402

PAGE = ROOT / "docs" / "protocol.md"
MAKER = "benchmarks/protocol_reference.py"

TABLES: tuple[tuple[str, type, str], ...] = (
    ("The beginning of the file", types.Protocol, ""),
    ("[workspace]", types.Workspace, "workspace"),
    ("[grid]", types.Grid, "grid"),
    ("[loop]", types.Imperfections, "loop"),
    ("[disturbance]", types.Disturbances, "disturbance"),
    ("[fixed_disturbance]", Disturbance, "fixed_disturbance"),
    ("[stability]", types.Stability, "stability"),
    ("[settling]", types.Settling, "settling"),
    ("[[tests]]", Test, "tests"),
    ("again of a test", Again, "again"),
    ("[criteria.NAME]", types.Criterion, "criteria"),
    ("[jitter]", types.Jitter, "jitter"),
    ("[selection]", types.Selection, "selection"),
)
"""Heading, type, and the key of the part of a protocol that is of this type."""

MEANINGS = {
    "Protocol": {
        "benchmark": "version of the benchmark",
        "name": "name of the protocol; part of the name of the results' folder",
        "description": "one line about it",
        "workspace": "table: ranges of the link angles",
        "grid": "table: the configurations",
        "loop": "table: sample time, delay, noise, quantization, limits",
        "disturbance": "table: force and chirp",
        "fixed_disturbance": "table: the disturbance of tests that draw nothing",
        "uncertainty": "half-width of each uncertain parameter, relative to its nominal value; key: symbol",
        "systems": "tables by name: +1 or -1 puts a parameter at that end of its range on both axes",
        "sets": "lists of systems by name, for `systems` of a test; `random_1`, `random_2`, ... are drawn by the seed",
        "stability": "table: how the end of a simulation is judged",
        "settling": "table: how B6 is measured",
        "tests": "list of tables: the experiments",
        "criteria": "tables by name, B1 to B7: targets and weights",
        "reference": "values of the criteria and of V that the paper reports",
        "extends": "name or path of a protocol whose contents hold where this file says nothing",
        "jitter": "table: by how much the seed moves what is listed",
        "selection": "table: a part of the tests and poses",
    },
    "Workspace": {"q_a1_deg": "range of q_a[1] [degrees]", "q_a2_deg": "range of q_a[2] [degrees]"},
    "Grid": {
        "q_a1_points": "number of equidistant angles of link 1; with 2 and more, both ends of the range are among them",
        "q_a2_points": "the same for link 2",
        "also_deg": "further configurations (q_a1, q_a2) [degrees]",
    },
    "Imperfections": {
        "sample_time": "T_s [s]",
        "delay": "T_d [s]",
        "noise_power": "P_n [rad2.s]",
        "angle_range_deg": "range of the quantized motor angle [degrees]",
        "angle_bits": "number of bits for this range",
        "torque_limit": "u_max of axis 1 and 2 [N.m]",
        "torque_bits": "number of bits for the range from -u_max to u_max",
        "abort_distance": "TCP error at which a simulation ends as unstable [m]",
    },
    "Disturbances": {
        "force": "size of the force on the TCP [N]",
        "t_1": "begin of the force [s]",
        "t_2": "end of the force [s]",
        "chirp_amplitude": "amplitude of the chirp of axis 1 and 2 [N.m]",
        "t_3_range": "range of the begin of the chirp [s]",
        "t_4": "end of the chirp [s]",
        "chirp_frequencies": "first and last frequency of the chirp [Hz]",
    },
    "Disturbance": {
        "phi_F": "direction of the force [rad]",
        "t_3": "begin of the chirp [s]",
        "f_start": "frequency at its begin [Hz]",
        "f_stop": "frequency at its end [Hz]",
        "late": "delay of the force [s]",
    },
    "Stability": {
        "limit_cycle": "A3: limit of half the largest distance between two places of the TCP [m]",
        "limit_cycle_window": "length of a window at the end of a simulation [s]",
        "ring_down": "a motion that falls below this share from each window to the next dies away",
        "recovery_error": "TCP error below which the controller has recovered from the force [m]",
        "rest_error": "TCP error above which the end of a simulation is unstable [m]",
        "rest_window": "length of the end over which this is judged [s]",
        "limit_cycle_windows": "number of windows",
        "doubtful": "amplitude from which a verdict may be in doubt [m]",
        "dying": "there is no doubt if each window falls below this share of the one before",
        "longest": "time until which a case in doubt is simulated [s]",
    },
    "Settling": {"error": "TCP error below which the arm has settled [m]"},
    "Test": {
        "name": "name of the test; part of the names of its cases",
        "systems": "name of one of the `sets`",
        "duration": "simulated time [s]",
        "disturbed": "whether force and chirp act",
        "axis": "axis that `gain` and `delay` act on; 0: none",
        "gain": "factor of the loop gain",
        "delay": "additional delay [s]",
        "criteria": "which of B1 to B7 are measured",
        "requirements": "which of A1 to A3 are judged",
        "draws": "whether each system draws its disturbance; if not, it is the fixed one",
        "direction_deg": "direction of the force [degrees], in place of the fixed one",
        "sweep": "`up`: the chirp goes from low to high frequency; `down`: from high to low",
        "noise": "number of the realization of the noise",
        "repeats": "name of a test that this one repeats with another disturbance",
        "poses": "indices of configurations; none means all",
        "again": "table: how often force and chirp come; once, if left out",
    },
    "Again": {
        "period": "time from one force to the next [s]; the chirp has the same",
        "number": "how often they come",
        "turn_deg": "angle between one force and the next [degrees]",
    },
    "Criterion": {
        "target": "value that costs its weight",
        "weight": "w_i of eq. (14)",
        "unit": "SI unit",
        "title": "name in tables",
    },
    "Jitter": {
        "pose_deg": "largest change of a link angle [degrees]",
        "system": "largest change of a parameter inwards, as a share of its half-width",
        "direction_deg": "largest change of the direction of the force [degrees]",
        "force_time": "largest change of begin and end of the force, together [s]",
        "tests": "whether the tests of a system differ in noise and disturbance",
    },
    "Selection": {
        "tests": "patterns of the names of tests, such as `gain_*`; none means all",
        "poses": "indices of configurations, for all of these tests; none means all",
    },
}


def tables() -> str:
    """All tables, each below its heading."""
    whole = plain(types.load("paper"))
    return "\n".join(_table(heading, kind, _part(whole, key)) for heading, kind, key in TABLES)


def _part(whole: dict[str, Any], key: str) -> dict[str, Any]:
    """The part of a protocol below a key; of a list or of tables by name, the first one."""
    part = whole.get(key, whole) if key else whole
    if key == "tests":
        return dict(part[0])
    return dict(next(iter(part.values()))) if key == "criteria" else dict(part)


def _table(heading: str, kind: type, example: dict[str, Any]) -> str:
    rows = "".join(
        f"| `{field.encode_name}` | {_allowed(field.type)} | {_default(field)} | {_example(example, field)} "
        f"| {MEANINGS[kind.__name__][field.encode_name]} |\n"
        for field in inspect.type_info(kind).fields  # type: ignore[attr-defined]
    )
    title = heading if heading[0] != "[" else f"`{heading}`"
    return f"### {title}\n\n| field | allowed | if left out | in `paper` | meaning |\n|---|---|---|---|---|\n{rows}"


def _default(field: inspect.Field) -> str:
    if field.required:
        return "required"
    return "none" if isinstance(field.default, msgspec.Struct) else _written(plain(field.default))


def _example(example: dict[str, Any], field: inspect.Field) -> str:
    value = example.get(field.encode_name)
    nested = isinstance(value, dict) or (isinstance(value, list | tuple) and value and isinstance(value[0], dict))
    return "" if nested or value in (None, "", [], ()) else _written(value)


def _written(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, list | tuple):
        return f"`{[*value]}`".replace("'", '"')
    return "none" if value is None else f"`{value!r}`".replace("'", '"')


def _allowed(kind: inspect.Type) -> str:
    """The values that a type allows, in words."""
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        return _number(kind)
    if isinstance(kind, inspect.LiteralType):
        return ", ".join(f'`"{value}"`' for value in kind.values)
    if isinstance(kind, inspect.CustomType) and kind.cls is Fraction:
        return 'number or text such as `"1/4000"`'
    if isinstance(kind, inspect.TupleType):
        return f"list of {len(kind.item_types)}: {_allowed(kind.item_types[0])}"
    if isinstance(kind, inspect.VarTupleType):
        return f"list: {_allowed(kind.item_type)}"
    if isinstance(kind, inspect.DictType):
        return f"table by name: {_allowed(kind.value_type)}"
    if isinstance(kind, inspect.UnionType):
        return _allowed(kind.types[0])
    words = {inspect.BoolType: "`true`, `false`", inspect.StrType: "text", inspect.StructType: "table"}
    return words[type(kind)]


def _number(kind: inspect.IntType | inspect.FloatType) -> str:
    name = "integer" if isinstance(kind, inspect.IntType) else "number"
    low, high = kind.ge if kind.ge is not None else kind.gt, kind.le
    bounded = high is not None and abs(high) < min(MAX_FLOAT, 2**53)
    if kind.gt is not None:
        return f"{name} above {kind.gt:g}"
    if low is None or low <= -MAX_FLOAT:
        return name
    return f"{name} from {low:g} to {high:g}" if bounded else f"{name}, at least {low:g}"


def page() -> str:
    """What the page should say."""
    return with_table(PAGE.read_text(encoding="utf-8"), "\n" + tables() + "\n", MAKER)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
