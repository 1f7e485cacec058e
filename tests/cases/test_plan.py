"""nhbm plan: size of the result file, forecast of a run over ranks, messages."""

import csv

import h5py
import pytest

from program import run, solve

INPUT = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.02 /
&tones frequency = 0.5 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&solver first_guess = 'linear' /
&sweep parameter = 'tones%frequency', from = 0.5, to = 0.9, n = 20 /
"""


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "case.nml"
    path.write_text(INPUT)
    return path


def plan(source, *options, status=0):
    done = run("plan", source, *options, cwd=source.parent)
    assert done.status == status, done.stderr
    return done


def table_of(source, *options):
    plan(source, *options, "-o", source.with_suffix(".csv"))
    with source.with_suffix(".csv").open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_size_is_that_of_the_file(source, tmp_path):
    words = plan(source).stdout.split()
    n_points, n_bytes, n_datasets = int(words[0]), int(words[3]), int(words[6])
    with h5py.File(solve(INPUT, tmp_path), "r") as file:
        rows = [d for d in file.values() if d.shape and d.shape[0] == 20 and d.dims[0].keys() or d.name == "/point"]
        rows = [d for d in rows if d.name == "/point" or file["point"] == d.dims[0][0]]
        assert n_points == 20
        assert n_bytes * 20 == sum(d.size * d.dtype.itemsize for d in rows)
        assert n_datasets == len(rows) - 2, "all but the scale and the swept parameter, which stand there from the start"


def test_equal_points_on_ranks(source):
    """Twenty points of a second: twenty seconds on one rank, ten on two, seven on three."""
    fast = ("--machine", "latency=1e-9", "--machine", "write_rate=1e12", "--machine", "write_latency=1e-9")
    rows = table_of(source, "--cost", "1.0", "--ranks", "1,2,3", *fast, "--machine", "counter_rate=1e12")
    assert [row["ranks"] for row in rows] == [1, 2, 3]
    assert [row["seconds"] for row in rows] == pytest.approx([20.0, 10.0, 7.0], abs=1e-3)
    assert rows[2]["efficiency"] == pytest.approx(20.0 / 21.0, abs=1e-3)
    assert rows[2]["idle"] == pytest.approx(1.0 / 21.0, abs=1e-3)


def test_costs_of_a_result(source, tmp_path):
    result = solve(INPUT, tmp_path)
    with h5py.File(result, "r") as file:
        seconds = file["solve_seconds"][()].sum()
    (row,) = table_of(source, "--cost-from", result, "--points", "200", "--ranks", "1")
    assert row["points"] == 200
    assert row["seconds"] * row["efficiency"] == pytest.approx(10 * seconds, rel=1e-4)


def test_several_ranks_measure_a_counter(source):
    done = run("plan", source, "--cost", "1.0", "--ranks", "2", cwd=source.parent, ranks=2)
    assert done.status == 0, done.stderr
    first, *rest = done.stdout.splitlines()
    latency, rate = (float(word.partition("=")[2]) for word in first.split()[-2:])
    assert first.startswith("measured among 2 ranks: latency=") and len(rest) == 3
    assert 1e-9 < latency < 1e-2 and 1e2 < rate < 1e10


def test_points_fill_whole_lines(source):
    assert plan(source, "--points", "21").stdout.startswith("40 points ")


def test_hundred_thousand_ranks(source):
    """Ten times more points than ranks: nothing overflows, nobody gets lost."""
    (row,) = table_of(source, "--points", "1e6", "--cost", "100.0,0.5", "--ranks", "1e5")
    assert 0.5 < row["efficiency"] < 1.0
    assert row["efficiency"] + row["drawing"] + row["writing"] + row["idle"] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    "options, message",
    [
        (["--ranks", "2,x"], "--ranks: 'x' is no number"),
        (["--ranks", "0"], "--ranks: '0' is no number from 1"),
        (["--points", "1e12"], "--points: '1e12' is no number"),
        (["--cost", "-1.0"], "--cost: '-1.0' is no number"),
        (["--cost-from", "none.h5"], "--cost-from 'none.h5'"),
        (["--machine", "latenzy=1"], "unknown key 'latenzy'; did you mean 'latency'?"),
        (["--machine", "latency"], "--machine latency: '' is no number"),
        (["--cost", "1.0", "-o", "none/plan.csv"], "'none/plan.csv' cannot be written"),
        (["--machine"], "--machine needs a value"),
    ],
)
def test_mistakes_are_told(source, options, message):
    assert message in plan(source, *options, status=2).stderr
