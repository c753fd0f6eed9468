"""The way back: the benchmark's own FMUs, closed to a loop by other masters, with the trajectory of the benchmark's.

The others couple in parallel (Jacobi): in each step every FMU sees the others' outputs of the step before. That is the
benchmark's coupling with one sample of delay on the way to the motors, and without noise, quantization and saturation.
"""

from __future__ import annotations

import ctypes
from importlib.metadata import PackageNotFoundError, distribution, files
from pathlib import Path

import numpy as np
import pytest
from closed_loops import simulate_all
from fmpy import read_model_description
from pid_fmus import T_S, in_child

from orchestrator.cosim.scenario import Drive, Pulse, Scenario, seconds

STEPS = 400
Q_M_REF, U_M0, Q_M, U_M = (tuple(f"{name}[{axis}]" for axis in (1, 2)) for name in ("q_m_ref", "u_m0", "q_m", "u_m"))

PUSH = {"F[1]": 50.0, "F[2]": -20.0}
"""A force on the tool [N] that sets the arm in motion."""

Row = tuple[float, ...]


def couple_in_our_master(plant: Path, controller: Path) -> tuple[Row, list[Row]]:
    """Return the steady state's q_m_ref [rad] and u_m0 [N.m], and q_m and u_m after each step."""
    sample = seconds(T_S)
    scenario = Scenario(
        (), STEPS * sample, sample, drive=Drive(delay=(sample, sample)), pulse=Pulse(tuple(PUSH.values()), 0.0, 1e9)
    )
    (found,) = simulate_all(plant, controller, [scenario])
    rows = np.hstack([found.q_m[1:], found.command])
    return (*found.q_m_ref, *found.u_m0), [tuple(row) for row in rows.tolist()]


def couple_in_libcosim(plant: Path, controller: Path, steady_state: Row) -> list[Row]:
    """Return q_m and u_m after each step of libcosim's fixed-step algorithm."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(step_size=round(T_S * 1e9))
    arm, pid = (
        execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name=name))
        for path, name in ((plant, "arm"), (controller, "pid"))
    )
    of_arm, of_pid = _references(plant), _references(controller)
    for name, value in PUSH.items():
        execution.real_initial_value(arm, of_arm[name], value)
    for name, value in zip(Q_M_REF + U_M0, steady_state, strict=True):
        execution.real_initial_value(pid, of_pid[name], value)
    for name in Q_M:
        execution.connect_real_variables(arm, of_arm[name], pid, of_pid[name])
    for name in U_M:
        execution.connect_real_variables(pid, of_pid[name], arm, of_arm[name])
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    trajectory = []
    for _ in range(STEPS):
        assert execution.step()
        q_m = observer.last_real_values(arm, [of_arm[name] for name in Q_M])
        u_m = observer.last_real_values(pid, [of_pid[name] for name in U_M])
        trajectory.append((*q_m, *u_m))
    return trajectory


def couple_in_ecos(plant: Path, controller: Path, steady_state: Row) -> list[Row]:
    """Return q_m and u_m after each step of ecos' fixed-step algorithm."""
    _load_tbb()
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("arm", plant)
        structure.add_model("pid", controller)
        for name in Q_M:
            structure.make_real_connection(f"arm::{name}", f"pid::{name}")
        for name in U_M:
            structure.make_real_connection(f"pid::{name}", f"arm::{name}")
        start = dict(zip(Q_M_REF + U_M0, steady_state, strict=True))
        structure.add_parameter_set(
            "start",
            {
                **{f"arm::{name}": value for name, value in PUSH.items()},
                **{f"pid::{name}": value for name, value in start.items()},
            },
        )
        trajectory = []
        with EcosSimulation(structure=structure, step_size=T_S) as simulation:
            simulation.init(parameter_set="start")
            for _ in range(STEPS):
                simulation.step()
                q_m = tuple(simulation.get_real(f"arm::{name}") for name in Q_M)
                trajectory.append(q_m + tuple(simulation.get_real(f"pid::{name}") for name in U_M))
            simulation.terminate()
        return trajectory


def _references(fmu: Path) -> dict[str, int]:
    return {variable.name: variable.valueReference for variable in read_model_description(str(fmu)).modelVariables}


def _load_tbb() -> None:
    """Load the library that ecos wants and the dynamic linker does not find in a virtual environment."""
    library = next(file for file in files("tbb") or () if file.name == "libtbb.so.12")
    ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)


@pytest.fixture(scope="module", params=["pid_file", "pid_c_file"])
def controller_file(request: pytest.FixtureRequest) -> Path:
    """The default controller in Python and in C."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def coupled_by_us(plant_file: Path, controller_file: Path) -> tuple[Row, list[Row]]:
    """Steady state and trajectory to hold other masters against."""
    return couple_in_our_master(plant_file, controller_file)


@pytest.mark.parametrize(
    ("couple", "packages"),
    [(couple_in_libcosim, ("libcosimpy",)), (couple_in_ecos, ("ecospy", "tbb"))],
    ids=["libcosim", "ecos"],
)
def test_same_trajectory_in_another_master(couple, packages, plant_file, controller_file, coupled_by_us):
    for package in packages:
        try:
            distribution(package)
        except PackageNotFoundError:
            pytest.skip(f"{package} not installed (pip install '.[exporters]')")
    steady_state, expected = coupled_by_us
    moved = max(abs(row[0] - steady_state[0]) for row in expected)
    assert moved > 1e-3, "the force should set the arm in motion"
    assert in_child(couple, plant_file, controller_file, steady_state) == expected
