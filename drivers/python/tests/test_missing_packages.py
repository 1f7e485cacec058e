"""Messages where an optional package is missing: they name it, and the extra of nhbm that installs it."""

import re
import sys
from pathlib import Path

import pytest
import scipy.sparse as sp

from nhbm import ModelError, command, examples, importing, meshes
from nhbm.structure import Structure

PROJECT = (Path(__file__).resolve().parents[3] / "pyproject.toml").read_text()


def mesh(folder):
    (folder / "wire.vtk").write_text("")
    unit = sp.identity(1)
    meshes.add_mesh(Structure(mass=unit, stiffness=unit, **importing.nodes_of_labels(["n1.z"])), folder / "wire.vtk")


def picture(folder):
    import xarray

    import nhbm.accessor  # noqa: F401

    xarray.Dataset({"response": ("point", [1.0]), "status": ("point", ["converged"])}).nhbm.plot()


def file(folder):
    from nhbm import open_dataset

    open_dataset(folder / "beam.h5")


@pytest.mark.parametrize(
    "module, package, extra, work",
    [
        ("meshio", "meshio", "fe", mesh),
        ("skfem", "scikit-fem", "fe", lambda folder: examples.plate()),
        ("matplotlib", "matplotlib", "plot", picture),
        ("h5netcdf", "h5netcdf", "", file),
    ],
)
def test_missing_package_and_its_extra_are_named(module, package, extra, work, monkeypatch, tmp_path):
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    message = f"{package}, which is not installed: pip install {package}"
    if extra:
        message += f", or in the folder of nhbm: pip install '.[{extra}]'"
    with pytest.raises(ModelError, match=re.escape(message) + "$"):
        work(tmp_path)
    assert re.search(rf'^{extra or "dependencies"} = \[.*"{package}[>"]', PROJECT, re.MULTILINE)


def test_command_names_the_missing_package(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "meshio", None)
    monkeypatch.chdir(tmp_path)
    for name in ("k.mtx", "m.mtx"):
        (tmp_path / name).write_text("%%MatrixMarket matrix coordinate real symmetric\n1 1 1\n1 1 1.0\n")
    (tmp_path / "labels").write_text("n1.z\n")
    (tmp_path / "wire.vtk").write_text("")
    words = ["import", "--mass=m.mtx", "--stiffness=k.mtx", "--labels=labels", "--mesh=wire.vtk", "--output=model.h5"]
    assert command.main(words) == 2
    assert "meshes are read with meshio, which is not installed" in capsys.readouterr().err
