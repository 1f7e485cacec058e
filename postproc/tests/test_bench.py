"""Pictures of the times of kernels."""

import h5py
import numpy as np
import pytest
from nhbm_post.bench import KERNELS, KernelTimes
from nhbm_post.cli import main
from nhbm_post.draw import draw_bench
from nhbm_post.errors import ReaderError
from nhbm_post.reader import SCHEMA_VERSION


@pytest.fixture
def times(tmp_path):
    """Four sizes at which the tangent costs n^2, all else n; the largest is not solved."""
    path = tmp_path / "times.h5"
    n = np.array([10, 20, 40, 80])
    with h5py.File(path, "w") as file:
        file.attrs.update(kind="bench", schema_version=SCHEMA_VERSION, title="Test")
        for name, values in (
            ("n_tones", [2] * 4),
            ("n_harmonics", n),
            ("n_unknowns", 2 * n - 1),
            ("n_samples", n**2),
            ("n_channels", [1] * 4),
            ("status", [1, 1, 1, 3]),
        ):
            file[name] = np.asarray(values, dtype=np.int32)
        file["parameter_harmonics_order"] = n / 10.0
        file["parameter_harmonics_order"].attrs["parameter"] = "harmonics%order"
        for kernel in KERNELS:
            seconds = 1e-9 * n.astype(float) ** (2 if kernel == "tangent" else 1)
            for end, factor in (("seconds", 1.0), ("seconds_min", 0.9), ("yardstick", 2.0)):
                file[f"{kernel}_{end}"] = factor * seconds
    return path


def test_exponents_are_those_of_the_file(times):
    exponents = dict(draw_bench(KernelTimes(times), "n_harmonics")[1])
    assert exponents["tangent"].exponent == pytest.approx(2.0, abs=1e-9)
    assert exponents["residual"].exponent == pytest.approx(1.0, abs=1e-9)
    assert 3 not in exponents["solution"].points


def test_sizes_by_column_and_by_path(times):
    data = KernelTimes(times)
    assert data.varying() == "n_unknowns"
    np.testing.assert_array_equal(data.column("harmonics%order"), [1.0, 2.0, 4.0, 8.0])
    with pytest.raises(ReaderError, match="sizes of this file"):
        data.column("n_nothing")


def test_files_are_joined(times):
    assert KernelTimes(times, times).n_points == 8


def test_command_draws_and_prints(times, capsys):
    assert main(["bench", str(times), "--also", str(times), "--over", "harmonics%order"]) == 0
    assert "tangent: time ~ n^2" in capsys.readouterr().out
    assert times.with_name("times_bench.png").exists()


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file.attrs["kind"] = "benchmark"
    with pytest.raises(ReaderError, match="no file of 'nhbm bench'"):
        KernelTimes(path)
