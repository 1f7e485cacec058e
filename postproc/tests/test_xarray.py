"""The schema opens with xarray as it is; single numbers are selected by tuple and by parameter.

netCDF-C before 4.9.1 ends the process on arrays of fixed-size strings (its issue 2159), which a test
cannot survive. There the engine netcdf4 is tried with messages written as characters along a netCDF
dimension, which loads everywhere.
"""

import re

import numpy as np
import pytest
from conftest import single, walled, write_sweep

from nhbm_post import Results

xarray = pytest.importorskip("xarray")


def engine_case(engine, layout):
    """Parameter set that is skipped where the engine is missing or cannot survive the layout."""
    marks = []
    try:
        module = __import__({"netcdf4": "netCDF4"}.get(engine, engine))
    except ImportError:
        marks.append(pytest.mark.skip(reason=f"no {engine}"))
    else:
        if engine == "netcdf4" and layout == "fixed":
            version = tuple(int(part) for part in re.findall(r"\d+", module.__netcdf4libversion__)[:3])
            is_fatal = version < (4, 9, 1)
            marks.append(
                pytest.mark.skipif(is_fatal, reason=f"netCDF-C {version} crashes on fixed-size strings")
            )
    return pytest.param(engine, layout, marks=marks, id=f"{engine}-{layout}")


CASES = [engine_case(engine, layout) for engine in ("h5netcdf", "netcdf4") for layout in ("fixed", "chars")]


@pytest.mark.parametrize("engine, layout", CASES)
def test_selects_by_tuple_and_parameter(tmp_path, engine, layout):
    path = write_sweep(tmp_path / "sweep.h5", message_layout=layout)
    with xarray.open_dataset(path, engine=engine) as data:
        assert data.coefficients.dims == ("point", "dof", "harmonic", "component")
        assert data.coefficients.attrs["units"] == "m"
        h = int(np.flatnonzero((data["tuple"] == [1, -2]).all("tone"))[0])
        is_wanted = (abs(data.law_1_gap - 1.5e-3) < 1e-12) & (data.solver_method == "newton")
        point = int(np.flatnonzero(is_wanted)[0])
        found = data.coefficients.isel(point=point, harmonic=h).sel(dof="v3", component="sin")
        by_gap = data.set_coords("law_1_gap").swap_dims(point="law_1_gap").isel(law_1_gap=slice(0, 3))
        same = by_gap.coefficients.sel(law_1_gap=1.5e-3, dof="v3", component="sin").isel(harmonic=h)
        with Results(path) as results:
            assert float(found) == float(same) == results.coefficients(1, "v3", (1, -2))[1]


@pytest.mark.parametrize("engine, layout", CASES)
def test_whole_file_loads(tmp_path, engine, layout):
    path = write_sweep(tmp_path / "sweep.h5", message_layout=layout)
    with xarray.open_dataset(path, engine=engine) as data:
        data.load()
        assert data.message.dims == ("point",)
        message = data.message.values[4]
        assert (message.decode() if isinstance(message, bytes) else message) == "dgetrf: singular matrix"


@pytest.mark.parametrize("engine, layout", CASES)
@pytest.mark.parametrize("n_tones", [1, 2, 3])
def test_surfaces_have_hypertime_axes(tmp_path, engine, layout, n_tones):
    path = walled(tmp_path / "a.h5", n_tones, message_layout=layout)
    with xarray.open_dataset(path, engine=engine) as data:
        axes = tuple(f"tau_{m}" for m in range(n_tones, 0, -1))
        assert data.displacement_samples.dims == ("point", "law_dof", *axes)
        assert data.tau_1.attrs["units"] == "rad"


def test_reads_beside_an_open_dataset(tmp_path):
    h5netcdf = pytest.importorskip("h5netcdf")
    path = single(tmp_path / "a.h5", 1)
    with h5netcdf.File(path, "r"), Results(path) as results:
        assert results.n_points == 1
