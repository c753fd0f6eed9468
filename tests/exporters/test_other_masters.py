"""The way back: the benchmark's own FMUs, closed to a loop by other masters, with the trajectory of the benchmark's.

Most others couple in parallel (Jacobi): in each step every FMU sees the others' outputs of the step before. That is the
benchmark's coupling with one sample of delay on the way to the motors, and without noise, quantization and saturation.
"""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from support.closed_loops import T_S, simulate_all
from support.pid_fmus import in_child, slave
from support.stub_fmus import axes
from support.tools import require

from orchestrator.loop.scenario import Drive, Pulse, Scenario

STEPS, STEP = 8000, float(T_S)
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


def couple_in_fmuloader(plant: Path, controller: Path, start: dict[str, float]) -> list[Row]:
    """Return q_m and u_m after each step of the loop that fmuloader leaves to its user."""
    from fmuloader.fmi2 import Fmi2Slave, Fmi2Type

    slaves, of = [], []
    for path, values in ((plant, PUSH), (controller, start)):
        described = read_model_description(str(path))
        of.append({variable.name: variable.valueReference for variable in described.modelVariables})
        slave = Fmi2Slave(path, model_identifier=described.coSimulation.modelIdentifier)
        slave.instantiate(path.stem, Fmi2Type.CO_SIMULATION, guid=described.guid)
        slave.setup_experiment(0.0, STEPS * STEP)
        slave.enter_initialization_mode()
        slave.set_real([of[-1][name] for name in values], list(values.values()))
        slave.exit_initialization_mode()
        slaves.append(slave)
    arm, pid = slaves
    (Q_M_of_arm, U_M_of_arm), (Q_M_of_pid, U_M_of_pid) = (
        [[of_one[n] for n in names] for names in (Q_M, U_M)] for of_one in of
    )
    trajectory, t = [], 0.0
    q_m, u_m = arm.get_real(Q_M_of_arm), pid.get_real(U_M_of_pid)
    for _ in range(STEPS):
        arm.set_real(U_M_of_arm, u_m)
        pid.set_real(Q_M_of_pid, q_m)
        for slave in slaves:
            slave.do_step(t, STEP)
        t += STEP
        q_m, u_m = arm.get_real(Q_M_of_arm), pid.get_real(U_M_of_pid)
        trajectory.append((*q_m, *u_m))
    return trajectory


def couple_in_pathsim(plant: Path, controller: Path, start: dict[str, float]) -> list[Row]:
    """Return q_m and u_m after each step of pathsim, which steps one block after the other and sets every input in each
    step: one that is connected to nothing to 0."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant
    from pathsim_fmi import CoSimulationFMU

    arm = CoSimulationFMU(str(plant), "arm", dt=STEP)
    pid = CoSimulationFMU(str(controller), "pid", start_values=start, dt=STEP)
    held = [(Constant(value), arm[name]) for name, value in PUSH.items()]
    held += [(Constant(value), pid[name]) for name, value in start.items() if name.startswith("q_m_ref")]
    lines = [Connection(arm[name], pid[name]) for name in Q_M] + [Connection(pid[name], arm[name]) for name in U_M]
    lines += [Connection(constant, port) for constant, port in held]
    simulation = Simulation([*(constant for constant, _ in held), pid, arm], lines, dt=STEP, log=False)
    trajectory: list[Row] = []
    for _ in range(STEPS):
        simulation.timestep(STEP, adaptive=False)
        trajectory.append((*(arm.outputs[name] for name in Q_M), *(pid.outputs[name] for name in U_M)))
    return trajectory


def couple_in_fmugym(plant: Path, controller: Path, start: dict[str, float]) -> list[Row]:
    """Return q_m, rounded to single precision, and u_m after each step: the plant is fmugym's, an agent has the PID."""
    from fmugym.fmugym import FMUGym
    from fmugym.fmugym_config import FMUGymConfig, VarSpace

    class Environment(FMUGym):  # type: ignore[misc]
        def _noisy_init(self) -> dict[int, float]:
            return {of_arm[name]: value for name, value in PUSH.items()}

        def compute_reward(self, *arguments: object) -> float:
            return 0.0

    of_arm, of_pid = (
        {variable.name: variable.valueReference for variable in read_model_description(str(fmu)).modelVariables}
        for fmu in (plant, controller)
    )
    spaces = {name: VarSpace(name) for name in ("inputs", "outputs", "random_vars", "input_noise", "output_noise")}
    for name in U_M:
        spaces["inputs"].add_var_box(name, -1e9, 1e9)
    for name in Q_M:
        spaces["outputs"].add_var_box(name, -1e9, 1e9)
    options = {"start_time": 0.0, "stop_time": STEPS * STEP, "sim_step_size": STEP, "action_step_size": STEP}
    gym = Environment(FMUGymConfig(fmu_path=str(plant), **options, **spaces))
    q_m, _ = gym.reset()
    trajectory = []
    with slave(controller) as pid:
        pid.fmu.setupExperiment(startTime=0.0)
        pid.fmu.enterInitializationMode()
        pid.set(tuple(start), tuple(start.values()))
        pid.fmu.exitInitializationMode()
        u_m = pid.get(U_M)
        for k in range(STEPS):
            pid.set(Q_M, q_m)
            pid.fmu.doStep(k * STEP, STEP)
            q_m, *_ = gym.step(np.array(u_m))
            u_m = pid.get(U_M)
            trajectory.append((*map(float, q_m), *u_m))
    return trajectory


@dataclass(frozen=True)
class Master:
    """Another master, and how near it comes to the benchmark's."""

    couple: Callable[[Path, Path, dict[str, float]], list[Row]]
    tools: tuple[str, ...]
    plant: str = "native_plant_file"
    controller: str = "pid_c_file"
    delay: int = 1
    """Samples from a measurement to its torque, by the master's order of exchange."""
    exact: int = STEPS
    """Steps with the same bits."""
    close: float = 0.0
    """The largest difference after that, relative to the range of each signal."""


MASTERS = {
    # Its steps are differences of times, whose rounding shows after some hundred steps.
    "libcosim": Master(couple_in_libcosim, ("libcosimpy",), controller="pid_file", exact=700, close=1e-12),
    "ecos": Master(couple_in_ecos, ("ecospy", "tbb"), plant="plant_file"),
    "fmuloader": Master(couple_in_fmuloader, ("fmuloader",)),
    "pathsim": Master(couple_in_pathsim, ("pathsim_fmi",), delay=0),
    # Observations are in single precision.
    "fmugym": Master(couple_in_fmugym, ("fmugym",), exact=0, close=1e-4),
}


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", MASTERS)
def test_same_trajectory_in_another_master(name, request):
    master = MASTERS[name]
    require(*master.tools)
    push = Pulse(tuple(PUSH.values()), 0.0, 1e9)
    files = [request.getfixturevalue(file) for file in (master.plant, master.controller)]
    drive = Drive(delay=(master.delay * T_S,) * 2)
    (ours,) = simulate_all(*files, [Scenario((), STEPS * T_S, T_S, drive=drive, pulse=push)])
    start = axes(q_m_ref=ours.q_m_ref, u_m0=ours.u_m0)
    assert np.abs(ours.q_m[:, 0] - ours.q_m_ref[0]).max() > 1e-3, "the force should set the arm in motion"
    expected = np.hstack([ours.q_m[1:], ours.command])
    found = np.array(in_child(master.couple, *files, start))
    assert np.array_equal(found[: master.exact], expected[: master.exact])
    assert (np.abs(found - expected).max(axis=0) <= master.close * np.ptp(expected, axis=0)).all()
