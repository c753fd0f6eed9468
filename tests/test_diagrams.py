"""The figures and tables that scripts write into docs/, and that the figure of the arm is the plant's kinematics."""

import math
from types import SimpleNamespace

import pytest
from numpy.testing import assert_allclose

from benchmarks import diagrams, protocol_reference
from orchestrator.loop.scenario import force
from plant_fmu.flexible_manipulator.kinematics import tcp
from plant_fmu.flexible_manipulator.parameters import NOMINAL


@pytest.mark.parametrize("name", diagrams.FIGURES)
def test_figures_are_those_of_the_script(name):
    drawn = (diagrams.PICTURES / name).read_text(encoding="utf-8")
    assert drawn == diagrams.FIGURES[name](), "python benchmarks/diagrams.py mends it"


@pytest.mark.parametrize("pose", [diagrams.POSE, (0.0, 0.0), (0.4, -1.2), (-1.0, 0.9)])
def test_the_arm_is_drawn_with_the_plants_kinematics(pose):
    l_1, l_2 = NOMINAL["l[1]"], NOMINAL["l[2]"]
    arm = SimpleNamespace(l_1=l_1, l_2=l_2)
    assert (l_1, l_2) == diagrams.LENGTHS
    assert_allclose(diagrams.joints(*pose)[1], getattr(tcp, "py_func", tcp)(arm, *pose), atol=1e-12)


def test_the_force_is_drawn_in_the_direction_in_which_it_acts():
    tip = diagrams.towards((0.0, 0.0), diagrams.PHI_F, 500.0)
    assert_allclose((tip[0], -tip[1]), force(500.0, diagrams.PHI_F), rtol=1e-12)
    assert_allclose(force(1.0, math.pi / 2), (0.0, 1.0), atol=1e-12)


def test_the_reference_of_protocol_files_has_every_field_of_the_types():
    written = protocol_reference.PAGE.read_text(encoding="utf-8")
    assert written == protocol_reference.page(), "python benchmarks/protocol_reference.py mends it"
