"""The starter kits: the commands of their READMEs work, and what they build is the benchmark's PID."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exporters import ARRAYS, Ports, Recipe
from exporters.drive import Errors, torques
from fmpy.validation import validate_fmu
from pid_fmus import Signals, law

import build_fmus
from controller_fmu.export.__main__ import EXIT_BAD_INPUT, EXIT_FAILED
from controller_fmu.export.__main__ import main as export

ROOT = Path(build_fmus.__file__).parent
UNDERSCORES = Ports(*((f"{name}_1", f"{name}_2") for name in ("q_m_ref", "q_m", "u_m", "u_m0")))


def follow_readme(kit: str, folder: Path) -> Path:
    """Copy a kit into ``folder``, run the shell commands of its README there, and return the copy."""
    copy = Path(shutil.copytree(ROOT / "examples" / kit, folder / kit))
    commands = re.findall(r"^```sh\n(.*?)^```", (copy / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    assert commands
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    for command in commands:
        subprocess.run(["bash", "-euc", command], cwd=copy, env=environment, check=True, capture_output=True)
    return copy


def test_python_kit(tmp_path):
    copy = follow_readme("python", tmp_path)
    check_torques("MyController", copy, UNDERSCORES)


@pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")
def test_c_kit(tmp_path):
    copy = follow_readme("c", tmp_path)
    for fmu in copy.glob("*.fmu"):
        assert validate_fmu(str(fmu)) == []
    check_torques("MyController", copy, Ports())
    check_torques("MyController3", copy, ARRAYS)


def check_torques(name: str, folder: Path, ports: Ports) -> None:
    """The FMU ``name`` in ``folder`` gives the torques of eq. (13), to the last bit."""
    errors = ((0.25, -0.5), (0.125, 0.75), (-1.0, 0.0), (0.5, 0.5))
    kit = Recipe(name, make=lambda path: path, ports=ports)
    wanted = law(Signals(np.array(errors), np.zeros((len(errors), 2)), (1.75, -0.25)))
    assert torques(kit, folder, Errors((0.0, 0.0), errors), (1.75, -0.25)) == [(1.75, -0.25), *wanted]


def test_c_command_says_what_is_missing(tmp_path, capsys):
    assert export(["--fmi", "3", str(tmp_path), str(tmp_path / "X.fmu")]) == EXIT_BAD_INPUT
    assert "needs the model's .c files and a modelDescription.xml" in capsys.readouterr().err


@pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")
def test_c_command_shows_what_the_compiler_says(tmp_path, capsys):
    folder = Path(shutil.copytree(ROOT / "examples" / "c", tmp_path / "c"))
    with (folder / "my_controller.c").open("a") as source:
        source.write("this is not C\n")
    assert export([str(folder), str(tmp_path / "X.fmu")]) == EXIT_FAILED
    assert "my_controller.c" in capsys.readouterr().err


def test_modelica_kit_compiles(tmp_path):
    pytest.importorskip("rumoca")
    follow_readme("modelica", tmp_path)


@pytest.mark.parametrize(
    ("right", "wrong", "complaint"),
    [
        ("K_p .* e", "K_q .* e", "unresolved component reference"),
        ("e = q_m_ref - q_m", "e = q_m_ref - T_s", "shape mismatch"),
        ("u_m = K_p .* e + K_d .* v + s;", "", "unbalanced model"),
    ],
)
def test_modelica_checker_finds_mistakes(right, wrong, complaint):
    rumoca = pytest.importorskip("rumoca")
    source = (ROOT / "examples" / "modelica" / "FlexibleManipulator.mo").read_text()
    assert right in source
    with pytest.raises(rumoca.RumocaError, match=complaint):
        rumoca.Session().loads(source.replace(right, wrong), model="FlexibleManipulator.DiagonalPID")
