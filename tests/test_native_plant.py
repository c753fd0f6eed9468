"""The plant in C against the plant in Python: one interface, one steady state, one motion, to the last bit.

Both have their own sine, cosine and exponential, so that equal bits are expected on every system.
"""

import ctypes
import math
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from fractions import Fraction

import fmpy
import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from hypothesis import given
from hypothesis import strategies as st
from support.closed_loops import GRID, PAPER, simulate_all
from support.manipulators import at_rest, table, uncertain_tables, workspace
from support.native_plants import INPUTS, NativePlant
from support.pid_fmus import built, in_child
from support.stub_fmus import strict_compiler

import build_fmus
from orchestrator.benchmark import cases
from plant_fmu.flexible_manipulator import integrator
from plant_fmu.flexible_manipulator.interface import VARIABLES
from plant_fmu.flexible_manipulator.parameters import NOMINAL
from plant_fmu.native.interface import DERIVATIVES, SPEEDS, STATES

pytestmark = pytest.mark.needs("compiler")

LINKS = ("q_a[1]", "q_a[2]")


@pytest.fixture(scope="module")
def model_exchange_files(fmu_folder):
    """The Model Exchange FMUs by FMI version."""
    return {version: built(f"FlexibleManipulatorNative_me{version}", fmu_folder) for version in (2, 3)}


@pytest.fixture(scope="module")
def native(native_plant_file):
    return NativePlant(native_plant_file)


def declared(description):
    """What a description says of each variable."""
    kept = ("valueReference", "description", "causality", "variability", "unit")
    return {
        v.name: (v.start and float(v.start), *(getattr(v, attribute) for attribute in kept))
        for v in description.modelVariables
    }


def test_both_have_the_same_variables(plant_file, native_plant_file):
    python, native = (read_model_description(str(path)) for path in (plant_file, native_plant_file))
    assert declared(native) == declared(python)
    assert [v.name for v in native.modelVariables] == [v.name for v in python.modelVariables]
    for list_name in ("outputs", "initialUnknowns"):
        names = [[u.variable.name for u in getattr(found, list_name)] for found in (native, python)]
        assert names[0] == names[1]


@pytest.mark.parametrize("name", build_fmus.PLANT_VARIANTS)
def test_variants_have_the_same_variables_and_more(name, native_plant_file, fmu_folder):
    variant = read_model_description(str(built(name, fmu_folder)))
    found, wanted = declared(variant), declared(read_model_description(str(native_plant_file)))
    assert {name: found[name] for name in wanted} == wanted
    more = [variable.name for variable in (*SPEEDS, *DERIVATIVES)] if "_me" in name else []
    assert [name for name in found if name not in wanted and name != "time"] == more
    assert [unknown.variable.derivative.name for unknown in variant.derivatives] == (list(STATES) if more else [])
    assert variant.numberOfContinuousStates == (len(STATES) if more else 0)


@pytest.mark.parametrize("version", [2, 3])
def test_dependencies_are_those_of_the_equations(version, model_exchange_files):
    """What an output or a derivative is declared to depend on is what changes it."""
    description = read_model_description(str(model_exchange_files[version]))
    plant = NativePlant(model_exchange_files[2])
    plant.initialize({**table(gamma=0.9), "q_a_start[1]": 0.3, "q_a_start[2]": -0.9})
    x, inputs = np.array(plant.get(*STATES)) + 0.01, np.array([1.0, 2.0, 0.1, 0.2, 30.0, 40.0])

    def values(name, change):
        moved, driven = x.copy(), inputs.copy()
        if name in STATES:
            moved[STATES.index(name)] += change
        else:
            driven[INPUTS.index(name)] += change
        plant.derivative(moved, driven)
        return plant.get(*(unknown.variable.name for unknown in unknowns))

    unknowns = [*description.outputs, *description.derivatives]
    changed = {name: np.array(values(name, 1e-3)) != np.array(values(name, 0.0)) for name in (*STATES, *INPUTS)}
    for row, unknown in enumerate(unknowns):
        found = {name for name, differs in changed.items() if differs[row]}
        assert {known.name for known in unknown.dependencies} == found, unknown.variable.name


@given(values=uncertain_tables(), q_a=workspace)
def test_the_steady_state_is_the_same(native, values, q_a):
    native.initialize({**values, **dict(zip(("q_a_start[1]", "q_a_start[2]"), q_a, strict=True))})
    python = at_rest(values, q_a)
    assert native.get(*(variable.name for variable in VARIABLES[6:12])) == python[6:12].tolist()
    rest = native.get("q_m_ref[1]", "q_m_ref[2]", "u_m0[1]", "u_m0[2]")
    assert rest == [*python[6:8], *python[0:2]]


@given(values=uncertain_tables(), factor=st.floats(0.0, 30.0), steps=st.lists(st.floats(0.0, 2e-3), max_size=5))
def test_steps_of_any_size_are_the_same(native, values, factor, steps):
    """Also where friction is so steep that substeps are shorter."""
    values = {**values, "alpha[1]": values["alpha[1]"] * factor}
    native.initialize(values)
    memory = at_rest(values, (0.0, 0.0))
    inputs = memory[0:6] + (3.0, -2.0, 0.5, 0.5, 200.0, -100.0)
    memory[0:6] = inputs
    for step in steps:
        native.step(inputs.tolist(), step)
        integrator.advance(memory, step)
    assert native.get(*(variable.name for variable in VARIABLES[6:12])) == memory[6:12].tolist()


@pytest.mark.parametrize("step", [-1e-9, float("nan"), float("inf")])
def test_steps_that_are_none_are_refused(native, step):
    native.initialize({})
    with pytest.raises(FMICallException):
        native.step([0.0] * 6, step)
    native.initialize({})
    native.step([0.0] * 6, 0.0)


def assert_equal_motions(plant, native, controller, scenarios):
    """The same numbers to the last bit, sample by sample, from two plants in the master loop."""
    with ThreadPoolExecutor(2) as pool:
        found, wanted = pool.map(lambda file: simulate_all(file, controller, scenarios, LINKS), (native, plant))
    for scenario, ours, theirs in zip(scenarios, found, wanted, strict=True):
        assert ours.ending == theirs.ending, scenario
        assert (ours.q_m_ref, ours.u_m0) == (theirs.q_m_ref, theirs.u_m0)
        for name in ("q_m", "X", "measured", "command", "torque"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=f"{name}, {scenario}")
        for name in LINKS:
            np.testing.assert_array_equal(ours.extra[name], theirs.extra[name])
    return found


@pytest.mark.slow
def test_cases_of_the_protocol_are_the_same(plant_file, native_plant_file, pid_c_file):
    """Every test with every named system at every pose for half a second, and some at a corner to the end."""
    everything = [found.scenario for found in cases.cases(PAPER, NOMINAL, seed=0)]
    whole = [found.scenario for found in cases.cases(PAPER, NOMINAL, seed=1) if found.configuration == GRID[0]][::3]
    short = [replace(scenario, duration=Fraction(1, 2)) for scenario in everything]
    trajectories = assert_equal_motions(plant_file, native_plant_file, pid_c_file, [*short, *whole])
    assert len(trajectories) == 18 * len(GRID) + 6
    assert min(np.ptp(found.q_m, axis=0).max() for found in trajectories) > 1e-6, "there is motion in each"


def simulated(paths, options):
    """Outputs of FMPy's own simulation from rest, pushed off it; in columns of time and OUTPUTS."""
    outputs = ["q_m[1]", "q_m[2]", "q_a[1]", "q_a[2]", "X[1]", "X[2]"]
    start = {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9, "u_m[1]": 4.0, "u_m[2]": -3.0, "F[1]": 200.0, "k_high[1]": 1e6}
    options = {"stop_time": 0.5, "output_interval": 1e-3, "start_values": start, "output": outputs, **options}
    return [np.array([tuple(row) for row in simulate_fmu(str(path), **options)]) for path in paths]


CVODE = {"solver": "CVode", "relative_tolerance": 1e-9}


def test_fmi_3_is_fmi_2_and_model_exchange_in_cvode_is_the_co_simulation(
    model_exchange_files, native_plant_file, fmu_folder
):
    """FMPy's integrator of variable step and order finds the motion that the plant's own steps find."""
    wanted, same = in_child(simulated, [native_plant_file, built("FlexibleManipulatorNative_fmi3", fmu_folder)], {})
    np.testing.assert_array_equal(same, wanted)
    for found in in_child(simulated, list(model_exchange_files.values()), CVODE):
        assert found.shape == wanted.shape and np.ptp(wanted[:, 5]) > 0.01
        np.testing.assert_allclose(found[:, 5:], wanted[:, 5:], rtol=0, atol=1e-7)
        np.testing.assert_allclose(found[:, 1:5], wanted[:, 1:5], rtol=0, atol=2 * math.pi / 2**16)  # a quantum


@pytest.mark.parametrize("name", ["FlexibleManipulatorNative", "FlexibleManipulatorNative_me3"])
def test_sources_compile_without_a_warning(name, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", strict_compiler())
    build_fmus.build(name, tmp_path)


@pytest.mark.needs("readelf")
def test_the_binary_needs_the_c_library_and_nothing_else(native_plant_file, tmp_path):
    extract(str(native_plant_file), str(tmp_path))
    binary = next((tmp_path / "binaries" / fmpy.platform).iterdir())
    listed = subprocess.run(["readelf", "-d", str(binary)], capture_output=True, text=True, check=True).stdout
    needed = {line.split("[")[1].rstrip("]") for line in listed.splitlines() if "(NEEDED)" in line}
    assert needed <= {"libm.so.6", "libc.so.6"}
    assert ctypes.CDLL(str(binary)).fmi2GetVersion
