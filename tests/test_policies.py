"""Policies: every way to an FMU gives the torques of the same network, and an episode is a simulation."""

import re
import runpy
import shutil
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numba
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from support.pid_fmus import T_S, in_child, live, random_signals
from support.refusals import refusal
from support.stub_fmus import strict_compiler
from support.tools import require
from test_documentation import run_code, smaller, text

from controller_fmu import controller_from_mlp, errors, starters
from controller_fmu.export import build_folder
from orchestrator import Benchmark, Controller, Variation


def network(activation, scale, hidden=7, seed=3):
    """A network of two hidden layers: where it is not saturated, and ``scale`` is small, some linear law."""
    random = np.random.default_rng(seed)
    W1, W2, W3 = (random.normal(size=shape) for shape in ((hidden, 8), (5, hidden), (2, 5)))
    biases = {f"b{k}": scale * random.normal(size=size) for k, size in ((1, hidden), (2, 5), (3, 2))}
    return {"W1": scale * W1, "W2": W2, "W3": W3, **biases, "activation": activation}


def torques(weights, q_m_ref, q_m, u_m0):
    """What the page says of a policy, as plainly as can be: shape (samples, 2)."""
    act = {"tanh": np.tanh, "relu": lambda x: x * (x > 0.0)}[weights["activation"]]
    e = q_m_ref - q_m
    s = T_S * np.cumsum(e, axis=0)
    v, rows = np.zeros(2), []
    for now, before in zip(e, np.vstack([np.zeros(2), e]), strict=False):
        v = 0.95 * v + 0.05 * (now - before) / T_S
        rows.append(v)
    x = np.hstack([e, rows, s, np.broadcast_to(q_m_ref, e.shape)])
    depth = len(weights) // 2
    for k in range(1, depth + 1):
        x = x @ np.asarray(weights[f"W{k}"]).T + weights[f"b{k}"]
        x = act(x) if k < depth else x
    return x + u_m0


@pytest.mark.needs("compiler")
@pytest.mark.parametrize(("activation", "scale"), [("tanh", 0.01), ("relu", 1.0)])
def test_a_network_in_c_has_the_torques_of_its_layers(activation, scale, tmp_path, monkeypatch):
    """From the start and from restored states; without a warning of the compiler."""
    monkeypatch.setenv("CC", strict_compiler())
    weights = network(activation, scale)
    np.savez(tmp_path / "policy.npz", **weights)
    file = controller_from_mlp(tmp_path / "policy.npz", out=tmp_path / "policy.fmu")
    assert validate_fmu(str(file)) == []
    assert controller_from_mlp(weights, out=file).read_bytes() == file.read_bytes()
    signals = random_signals()
    expected = torques(weights, signals.q_m_ref, signals.q_m, signals.u_m0)
    assert np.ptp(expected, axis=0).min() > 0.5
    life = in_child(live, file, signals, (0.0, 0.0), [], [])
    assert life["initial"] == signals.u_m0 and len(life["runs"]) == 5
    for run in life["runs"]:
        np.testing.assert_allclose(run, expected, rtol=1e-11)


REFUSED = {
    "W2": lambda good: {**good, "W2": good["W2"].T},
    "W1": lambda good: {**good, "b1": np.full(7, np.nan)},
    "W3": lambda good: {**good, "W3": np.ones((3, 5)), "b3": np.ones(3)},
    "elu": lambda good: {**good, "activation": "elu"},
    "W1, W3, b1": lambda good: {"W1": good["W1"], "b1": good["b1"][:2]} | {"W3": 1.0},
    "": lambda good: {"W1": np.ones((2, 8)), "b1": np.ones(2)},
}


@pytest.mark.parametrize("value", REFUSED)
def test_what_is_no_network_is_refused(value, tmp_path):
    error = refusal(
        controller_from_mlp, REFUSED[value](network("tanh", 1.0)), out=tmp_path / "x.fmu", kind=errors.NetworkError
    )
    assert error.value == value and not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """What the code of the page has defined, and the folder that it ran in."""
    require("compiler", "gymnasium", "greenlet", "onnx", "onnxruntime")
    folder = tmp_path_factory.mktemp("policies")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "CACHE_DIR", "")  # so that the machine code is that of the other processes
        patch.chdir(folder)
        (folder / "quick.toml").write_text(
            'extends = "quick"\nname = "one pose"\n[grid]\nq_a1_points = 1\nq_a2_points = 1\n'
        )
        yield run_code(smaller(text("docs/policies.md")), "docs/policies.md"), folder


@pytest.fixture(scope="module")
def case():
    """Shaken from the start."""
    bench = Benchmark("quick")
    return bench.varied(bench.case("c00.random_1.disturbance"), Variation(duration=Fraction(1, 4), t_3=0.0))


@pytest.fixture(scope="module")
def simulations(page, case):
    """The page's network by every kind of FMU."""
    folder, files = page[1], {"mlp": page[1] / "policy.fmu"}
    for kind, weights in (("numpy", "policy.npz"), ("onnx", "policy.onnx")):
        kit = starters.copy(kind, folder / f"my_{kind}")
        shutil.copy(folder / weights, kit)
        files[kind] = build_folder(kit)
        assert validate_fmu(str(files[kind])) == []
    return {kind: Benchmark("quick").simulate(Controller(file), case).trajectory for kind, file in files.items()}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mlp", "numpy", "onnx"])
def test_fmus_have_the_torques_of_the_network(kind, page, case, simulations):
    """From what the sensor showed: measured, then rounded."""
    found = simulations[kind]
    seen = np.rint(found.measured[:-1] / case.scenario.sensor.quantum) * case.scenario.sensor.quantum
    expected = torques({**page[0]["weights"], "activation": "tanh"}, np.array(found.q_m_ref), seen, found.u_m0)
    assert np.ptp(found.command, axis=0).min() > 0.1
    np.testing.assert_allclose(found.command, expected, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_an_episode_is_the_simulation_to_the_last_bit(page, case, simulations):
    """Also with another environment between two steps, and after an episode that was left."""
    import gymnasium

    weights = page[0]["weights"]
    env, other = (gymnasium.make("FlexibleManipulator-v1") for _ in range(2))
    other.reset(seed=1)
    env.reset(seed=1)
    observation, _ = env.reset(options={"case": case})
    ended, rewards = False, []
    while not ended:
        action = weights["W2"] @ np.tanh(weights["W1"] @ observation + weights["b1"]) + weights["b2"]
        observation, reward, terminated, ended, info = env.step(action)
        other.step(action)
        assert not terminated
        rewards.append(reward)
    found, expected = env.unwrapped.trajectory, simulations["numpy"]
    assert found.ending == expected.ending and info["status"] == "done"
    for name in ("time", "q_m", "X", "measured", "command", "torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_allclose(rewards, -1e3 * T_S * expected.tcp_error[1:], rtol=1e-9)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(action)


@pytest.mark.slow
def test_what_the_benchmark_gives_up_is_terminated_and_counts_to_the_end(page, case):
    import gymnasium

    env = gymnasium.make("FlexibleManipulator-v1")
    scenario = replace(case.scenario, abort_distance=1e-3)
    env.reset(options={"case": replace(case, scenario=scenario)})
    total, terminated = 0.0, False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.array([-30.0, 10.0]))
        total += reward
    error = env.unwrapped.trajectory.tcp_error
    rest = scenario.samples - (len(error) - 1)
    assert (truncated, info["status"]) == (False, "unstable") and rest > 100
    assert total == pytest.approx(-1e3 * T_S * (error[1:].sum() + rest * 1e-3), rel=1e-9)


@pytest.mark.slow
def test_gymnasiums_own_checker_is_content(page):
    """But for what it says of all that has units and no bounds."""
    import gymnasium
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("orchestrator.gym:FlexibleManipulator-v1", protocol="quick", duration=0.01)
    with pytest.warns(UserWarning) as caught:
        check_env(env.unwrapped)
    expected = ("symmetric and normalized", "minimum value is -infinity", "maximum value is infinity")
    assert len(caught) == len(expected), [str(one.message) for one in caught]
    assert all(words in str(one.message) for one, words in zip(caught, expected, strict=True))


@pytest.mark.slow
@pytest.mark.needs("gymnasium", "greenlet", "compiler")
def test_the_example_of_a_training_finds_better_gains(tmp_path, capsys):
    """With a small budget: the best return never falls, both policies are evaluated, and the curve is drawn."""
    example = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "train_policy.py"))
    gains, history = example["main"](2, 6, tmp_path)
    assert len(history) == 2 and history[0].best <= history[1].best < 0.0
    assert all(each.mean <= each.elite <= each.best for each in history)
    printed = capsys.readouterr().out.splitlines()
    first, trained = (float(re.search(r"V = ([\d.]+) on quick", line)[1]) for line in printed[-2:])
    assert trained < first and not np.array_equal(gains, example["START"])
    assert f"V falls from {first} to" in text("docs/policies.md")
    assert {file.name for file in tmp_path.iterdir()} == {"learning.svg", "trained.npz", "first.fmu", "trained.fmu"}


@pytest.fixture
def rendered(monkeypatch):
    """Makes environments that render."""
    require("gymnasium", "greenlet")
    import gymnasium

    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    made = []

    def make(mode):
        made.append(gymnasium.make("orchestrator.gym:FlexibleManipulator-v1", protocol="quick", render_mode=mode))
        return made[-1]

    yield make
    for env in made:
        env.close()


def test_the_arm_is_rendered_as_it_moves(rendered):
    env = rendered("rgb_array")
    env.reset(seed=0, options={"case": "c00.compliant.disturbance"})
    resting = env.render()
    for _ in range(200):
        env.step(np.array([30.0, 0.0]))
    moved = env.render()
    assert resting.shape == moved.shape == (400, 400, 3) and resting.dtype == np.uint8
    assert np.ptp(resting) > 200 and np.count_nonzero(resting != moved) > 1000


def test_a_window_follows_the_simulation(rendered, monkeypatch):
    from matplotlib import pyplot

    shown = []
    monkeypatch.setattr(pyplot, "pause", shown.append)
    env = rendered("human")
    env.reset(seed=0)
    for _ in range(320):  # two pictures of 40 ms
        env.step(np.zeros(2))
    assert len(shown) == 2


def test_actions_that_are_no_torques_are_refused(rendered):
    import gymnasium

    env = rendered(None).unwrapped
    env.reset(seed=0)
    for action in ([np.nan, 0.0], [np.inf, 0.0], [0.0], 1.0):
        with pytest.raises(gymnasium.error.InvalidAction, match="two finite torques"):
            env.step(np.array(action))
    with pytest.raises(gymnasium.error.Error, match="render_mode"):
        env.render()
    assert refusal(type(env), render_mode="ansi").what == "no-render-mode"
