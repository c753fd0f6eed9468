"""The wheel, installed away from the checkout: commands, starter kits and the library in an empty folder."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

SCRIPT = """
from orchestrator import Benchmark, Controller, Evaluation

mine = Controller("my_arm/MyArm.fmu", parameters={"K_p[1]": 50})
evaluation = Benchmark("quick", workers=2).evaluate(mine, only="c0[01].*.noise", folder="runs/x")
print(evaluation.criteria["B1"].value)
Evaluation.load("runs/x").report("report.html")
"""


@pytest.mark.slow
def test_wheel_in_an_empty_folder(tmp_path: Path) -> None:
    shutil.rmtree(ROOT / "build" / "lib", ignore_errors=True)  # setuptools would add what is left there
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(tmp_path)]
    subprocess.run([*build, str(ROOT)], check=True, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    environment = tmp_path / "environment"
    venv.create(environment, with_pip=False)
    site = Path(sysconfig.get_path("purelib", vars={"base": str(environment)}))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))  # of this environment, without its hooks
    install = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python"), "install", "-q"]
    subprocess.run([*install, "--no-deps", str(wheel)], check=True, cwd=tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*words: str, given: str | None = None) -> str:
        program, *rest = words
        options = {"cwd": empty, "env": outside, "input": given, "capture_output": True, "text": True, "check": False}
        finished = subprocess.run([str(environment / "bin" / program), *rest], **options)  # type: ignore[call-overload]
        assert finished.returncode == 0, finished.stderr
        return finished.stdout

    assert str(environment) in run("python", "-c", "import orchestrator; print(orchestrator.__file__)")
    run("flexible-manipulator", "new", "python", "my_arm")
    assert run("flexible-manipulator", "build", "my_arm").strip() == "my_arm/MyArm.fmu"
    printed = run("python", "-", given=SCRIPT)  # through standard input, where there is no main module to import
    assert float(printed) > 0 and (empty / "report.html").is_file()
    documents = environment / "share" / "doc" / "flexible-manipulator-benchmark"
    assert (documents / "docs" / "python.md").is_file() and (documents / "README.md").is_file()
