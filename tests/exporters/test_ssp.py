"""One case's closed loop as an SSP package: what other masters make of it, sample by sample."""

import ctypes
import io
import subprocess
import zipfile
from dataclasses import replace
from fractions import Fraction
from importlib.metadata import files
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.ssp.ssd import get_connections, read_ssd
from lxml import etree
from scipy.io import loadmat
from support.pid_fmus import built, in_child
from support.tools import require

from orchestrator import Benchmark, Controller, InputError
from orchestrator.loop.scenario import Chirp, Drive, Noise, Pulse, Sensor

from .description_edits import edited, unit
from .native import DEGREE

pytestmark = pytest.mark.needs("compiler")

MS = Fraction(1, 1000)
OBSERVED = ("q_m[1]", "q_m[2]", "X[1]", "X[2]")
BENCH = Benchmark(plant="native")
CASE = BENCH.case("c07.random_1.gain_1")
CASE = replace(
    CASE,
    scenario=replace(
        CASE.scenario,
        duration=Fraction(1, 2),
        sensor=Sensor(Noise(1e-4, (3, 1)), (MS / 2, Fraction(0)), 1e-4),
        drive=Drive((1.4, 0.9), (1.8, 0.2), (0.02, 0.01), (MS / 4, 2 * MS)),
        chirp=Chirp((1.0, -1.0), 0.05, 0.4, 1.0, 15.0),
        pulse=Pulse((60.0, -90.0), 0.1, 0.2),
    ),
)
"""Everything that the master does between controller and plant, in half a second."""

IN_DEGREES = (unit("rad", "deg", rad="1", factor=repr(DEGREE)),)
ORDER = [
    ("plant", "imperfections"),
    ("imperfections", "controller"),
    ("controller", "imperfections"),
    ("imperfections", "plant"),
]
"""No output of plant and controller depends directly on an input, each of the imperfections on one at most."""


def in_ecos(package: Path, samples: int, sample_time: float) -> list[list[float]]:
    """The plant's outputs after each sample, its steps half as long as the plant's, as the hints in the package ask."""
    library = next(file for file in files("tbb") or () if file.name == "libtbb.so.12")
    ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation

    rows, step = [], 0.125e-3
    with EcosSimulation(step_size=step, ssp_path=str(package)) as simulation:
        simulation.init(parameter_set="case")
        for _ in range(samples):
            simulation.step(round(sample_time / step))
            rows.append([simulation.get_real(f"plant::{name}") for name in OBSERVED])
        simulation.terminate()
    return rows


def in_sequence(package: Path, samples: int, sample_time: float) -> list[list[float]]:
    """The same from a master that sets inputs along the connections and reads each output after what it depends on,
    as OMSimulator does; everything is stepped at once."""
    system = read_ssd(str(package)).system
    folder, slaves, references = Path(fmpy.extract(str(package))), {}, {}
    for component in system.elements:
        unpacked = fmpy.extract(str(folder / component.source))
        described = fmpy.read_model_description(unpacked)
        slave = FMU2Slave(
            guid=described.guid, unzipDirectory=unpacked, modelIdentifier=described.coSimulation.modelIdentifier
        )
        references[component.name] = {v.name: v.valueReference for v in described.modelVariables}
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        for parameter in etree.parse(folder / f"resources/{component.name}.ssv").iterfind(".//{*}Parameter"):
            slave.setReal([references[component.name][parameter.get("name")]], [float(parameter[0].get("value"))])
        slave.enterInitializationMode()
        slaves[component.name] = slave
    lines = sorted(get_connections(system), key=lambda line: ORDER.index((line[0].parent.name, line[1].parent.name)))

    def exchange() -> None:
        for start, end in lines:
            value = slaves[start.parent.name].getReal([references[start.parent.name][start.name]])
            slaves[end.parent.name].setReal([references[end.parent.name][end.name]], value)

    exchange()
    for slave in slaves.values():
        slave.exitInitializationMode()
    rows = []
    for k in range(samples):
        exchange()
        for slave in slaves.values():
            slave.doStep(k * sample_time, sample_time)
        rows.append(slaves["plant"].getReal([references["plant"][name] for name in OBSERVED]))
    return rows


@pytest.mark.parametrize(
    ("master", "sample_time", "edits"),
    [(in_ecos, MS / 4, ()), (in_ecos, MS / 2, IN_DEGREES), (in_sequence, MS / 4, ())],
    ids=["ecos", "ecos-two-steps-a-sample-in-degrees", "in-sequence"],
)
def test_the_package_has_the_bits_of_our_own_loop(master, sample_time, edits, pid_c_file, tmp_path):
    if master is in_ecos:
        require("ecospy", "tbb")
    fmu, gains = pid_c_file, {}
    if edits:
        fmu = edited(pid_c_file, tmp_path / pid_c_file.name, *edits)
        start = {"K_p": (45.0, 15.0), "K_i": (30.0, 10.0), "K_d": (1.5, 0.5)}
        gains = {f"{name}[{i + 1}]": pair[i] * DEGREE for name, pair in start.items() for i in (0, 1)}
    controller = Controller(fmu, gains, sample_time=sample_time)
    ours = BENCH.simulate(controller, CASE).trajectory
    package = BENCH.export_ssp(controller, CASE, tmp_path / "case.ssp")
    found = in_child(master, package, len(ours.command), float(sample_time))
    assert np.array_equal(found, np.hstack([ours.q_m, ours.X])[1:])
    assert np.ptp(ours.q_m, axis=0).min() > 1e-3, "the arm should move"
    assert (np.abs(ours.torque).max(axis=0) == (1.8, 0.2)).all(), "the drives should saturate"


def in_omsimulator(package: Path, duration: float, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
    """The times of OMSimulator's communication points, and the plant's outputs there."""
    options = f"--stopTime={duration!r} --intervals={round(duration / sample_time)} --resultFile=found.mat --tempDir=."
    command = ["OMSimulator", str(package), *options.split()]
    told = subprocess.run(command, cwd=package.parent, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stdout + told.stderr
    assert "error:" not in told.stdout and "warning:" not in told.stdout, told.stdout
    content = loadmat(package.parent / "found.mat", chars_as_strings=False)
    names = ["".join(letters).strip(" \0") for letters in content["name"].T]
    places = {name: place for name, (block, place) in zip(names, content["dataInfo"][:2].T, strict=True) if block != 1}
    columns = {name: content["data_2"][place - 1] for name, place in places.items()}
    outputs = np.column_stack([columns[f"flexible_manipulator.loop.plant.{name}"] for name in OBSERVED])
    time = columns["time"]
    at_the_end = np.append(
        np.rint(np.diff(time) / sample_time) > 0, True
    )  # each point is written before the exchange too
    return time[at_the_end], outputs[at_the_end]


def notes(structure: etree._Element) -> list[etree._Element]:
    """The annotations."""
    return list(structure.iterfind(".//{*}Annotation"))


@pytest.mark.needs("OMSimulator")
@pytest.mark.parametrize("controller", ["DiagonalPID_C", "RobustLQG"])
def test_omsimulator_simulates_the_package_to_its_end(controller, fmu_folder, tmp_path):
    """With our bits, as long as its steps, the differences of times that it sums up, are the sample time."""
    sample_time, duration = float(MS / 4), float(CASE.scenario.duration)
    ours = BENCH.simulate(Controller(built(controller, fmu_folder)), CASE).trajectory
    package = BENCH.export_ssp(Controller(built(controller, fmu_folder)), CASE, tmp_path / "case.ssp", "in-sequence")
    time, found = in_omsimulator(package, duration, sample_time)
    expected = np.hstack([ours.q_m, ours.X])
    assert len(found) == len(expected) and time[-1] == duration
    exact = 1 + int(np.argmax(np.diff(time) != sample_time))
    assert exact > 4
    assert np.array_equal(found[:exact], expected[:exact])
    np.testing.assert_allclose(found[:, :2], expected[:, :2], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 2:], expected[:, 2:], rtol=0.0, atol=1e-8)
    assert np.ptp(ours.q_m, axis=0).min() > 1e-3, "the arm should move"


@pytest.mark.parametrize("order", ["parallel", "in-sequence"])
def test_the_files_are_what_the_standards_ask_for(order, pid_c_file, tmp_path):
    package = BENCH.export_ssp(Controller(pid_c_file), CASE, tmp_path / "case.ssp", order)
    again = BENCH.export_ssp(Controller(pid_c_file), CASE, tmp_path / "again.ssp", order)
    assert again.read_bytes() == package.read_bytes()
    home = Path(fmpy.__file__).parent
    ssd, ssv, terminals = (
        etree.XMLSchema(etree.parse(home / path))
        for path in (
            "ssp/schema/SystemStructureDescription.xsd",
            "ssp/schema/SystemStructureParameterValues.xsd",
            "schema/fmi3/fmi3TerminalsAndIcons.xsd",
        )
    )
    plugs = {}
    with zipfile.ZipFile(package) as opened:
        structure = etree.fromstring(opened.read("SystemStructure.ssd"))
        ssd.assertValid(structure)
        vendors = {(note.getparent().getparent().tag.partition("}")[2], note.get("type")) for note in notes(structure)}
        of_components = {("Component", "com.opensimulationplatform")}
        of_the_whole = {(name, "org.openmodelica") for name in ("System", "DefaultExperiment")}
        assert vendors == (of_components if order == "parallel" else of_the_whole)
        for name in ("plant", "imperfections", "controller"):
            ssv.assertValid(etree.fromstring(opened.read(f"resources/{name}.ssv")))
            with zipfile.ZipFile(io.BytesIO(opened.read(f"resources/{name}.fmu"))) as fmu:
                assert {"model.png", "terminalsAndIcons/icon.png"} <= set(fmu.namelist())
                described = etree.fromstring(fmu.read("terminalsAndIcons/terminalsAndIcons.xml"))
            terminals.assertValid(described)
            for plug in described.iterfind(".//Terminal"):
                plugs[name, plug.get("name")] = {line.get("memberName"): line.get("variableName") for line in plug}
    plant, pid = plugs["plant", "motors"], plugs["controller", "motors"]
    assert plant == pid == {name: name for name in ("q_m[1]", "q_m[2]", "u_m[1]", "u_m[2]")}
    assert list(plugs["imperfections", "controller"]) == list(pid)
    assert set(plugs["plant", "disturbances"]) == set(plugs["imperfections", "disturbances"])


@pytest.mark.parametrize(("delay", "problem"), [("0", "order"), ("1/3000", "unevenly")])
def test_what_other_tools_cannot_step_is_refused(delay, problem, pid_c_file, tmp_path):
    drive = replace(CASE.scenario.drive, delay=(Fraction(delay), MS / 4))
    with pytest.raises(InputError, match=problem) as caught:
        BENCH.export_ssp(
            Controller(pid_c_file),
            replace(CASE, scenario=replace(CASE.scenario, drive=drive)),
            tmp_path / "case.ssp",
        )
    assert caught.value.what == "no-ssp" and not list(tmp_path.iterdir())
