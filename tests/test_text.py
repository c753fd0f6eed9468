"""Text of strangers: harmless in a terminal and in the names of files."""

from hypothesis import given
from hypothesis import strategies as st

from orchestrator.text import file_name, printable


@given(st.text() | st.binary())
def test_nothing_steers_a_terminal(text):
    assert all(c.isprintable() or c in "\n\t" for c in printable(text))


def test_a_carriage_return_hides_nothing():
    assert printable("error\rfine\r\nnext") == "error\N{REPLACEMENT CHARACTER}fine\nnext"


@given(st.text())
def test_a_name_stays_one_name(text):
    found = file_name(text)
    assert len(found) == len(text) and not set(found) & set("/\\\0:*?\"'`$|<>;&~!\n\x1b") and not found.startswith(".")


def test_usual_names_stay():
    assert file_name("MyPID-paper-K_p[1]=60-T_s=0.00025") == "MyPID-paper-K_p[1]=60-T_s=0.00025"
