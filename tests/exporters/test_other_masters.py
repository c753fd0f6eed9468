"""The way back: the benchmark's own FMUs, closed to a loop by other masters, with the trajectory of the benchmark's.

The others couple in parallel (Jacobi): in each step every FMU sees the others' outputs of the step before. That is the
benchmark's coupling with one sample of delay on the way to the motors, and without noise, quantization and saturation.
"""

import ctypes
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from support.closed_loops import T_S, simulate_all
from support.pid_fmus import in_child
from support.stub_fmus import axes
from support.tools import require

from orchestrator.loop.scenario import Drive, Pulse, Scenario

STEPS, STEP = 400, float(T_S)
Q_M, U_M = ("q_m[1]", "q_m[2]"), ("u_m[1]", "u_m[2]")
PUSH = {"F[1]": 50.0, "F[2]": -20.0}
"""A force on the tool [N] that sets the arm in motion."""

Row = tuple[float, ...]


def couple_in_libcosim(plant: Path, controller: Path, start: dict[str, float]) -> list[Row]:
    """Return q_m and u_m after each step of libcosim's fixed-step algorithm."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(step_size=round(STEP * 1e9))
    arm, pid = (
        execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name=name))
        for path, name in ((plant, "arm"), (controller, "pid"))
    )
    of_arm, of_pid = (
        {variable.name: variable.valueReference for variable in read_model_description(str(fmu)).modelVariables}
        for fmu in (plant, controller)
    )
    for name, value in PUSH.items():
        execution.real_initial_value(arm, of_arm[name], value)
    for name, value in start.items():
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
        trajectory.append((*q_m, *observer.last_real_values(pid, [of_pid[name] for name in U_M])))
    return trajectory


def couple_in_ecos(plant: Path, controller: Path, start: dict[str, float]) -> list[Row]:
    """Return q_m and u_m after each step of ecos' fixed-step algorithm."""
    # The dynamic linker does not find the library that ecos wants in a virtual environment.
    library = next(file for file in files("tbb") or () if file.name == "libtbb.so.12")
    ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("arm", plant)
        structure.add_model("pid", controller)
        for name in Q_M:
            structure.make_real_connection(f"arm::{name}", f"pid::{name}")
        for name in U_M:
            structure.make_real_connection(f"pid::{name}", f"arm::{name}")
        pushed = {f"arm::{name}": value for name, value in PUSH.items()}
        structure.add_parameter_set("start", pushed | {f"pid::{name}": value for name, value in start.items()})
        names, trajectory = [f"arm::{name}" for name in Q_M] + [f"pid::{name}" for name in U_M], []
        with EcosSimulation(structure=structure, step_size=STEP) as simulation:
            simulation.init(parameter_set="start")
            for _ in range(STEPS):
                simulation.step()
                trajectory.append(tuple(simulation.get_real(name) for name in names))
            simulation.terminate()
        return trajectory


@pytest.mark.parametrize(
    ("couple", "tools", "plant", "controller"),
    [
        (couple_in_libcosim, ("libcosimpy",), "native_plant_file", "pid_file"),
        (couple_in_ecos, ("ecospy", "tbb"), "plant_file", "pid_c_file"),
    ],
    ids=["libcosim", "ecos"],
)
def test_same_trajectory_in_another_master(couple, tools, plant, controller, request):
    require(*tools)
    push = Pulse(tuple(PUSH.values()), 0.0, 1e9)
    files = [request.getfixturevalue(name) for name in (plant, controller)]
    (ours,) = simulate_all(*files, [Scenario((), STEPS * T_S, T_S, drive=Drive(delay=(T_S, T_S)), pulse=push)])
    start = axes(q_m_ref=ours.q_m_ref, u_m0=ours.u_m0)
    assert np.abs(ours.q_m[:, 0] - ours.q_m_ref[0]).max() > 1e-3, "the force should set the arm in motion"
    expected = [tuple(row) for row in np.hstack([ours.q_m[1:], ours.command]).tolist()]
    assert in_child(couple, *files, start) == expected
