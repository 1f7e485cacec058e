"""Times of small solutions in process from Python.

usage: python tests/bench/in_process.py        prints a table; NHBM_LIBRARY names the library, else that of build/release is taken

The Duffing oscillator of order 7 from the motion before, its frequency moved by 1e-4 at each point: least and median time of the
processor of 5,000 points, error estimate included. Then the same at 4,096 samples with laws of the catalogue, NumPy and (if it is
there) Numba. Then what users of Python wait for, with datasets, and beside it what the library or the command takes for the same.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "drivers" / "python" / "src"), str(ROOT / "postproc" / "src")]
import nhbm  # noqa: E402


def oscillator(**groups: dict) -> nhbm.Model:
    chain = nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.05)
    model = nhbm.Model(chain, tones=[0.9], **groups)
    model.load("x1", 1, cos=0.18)
    return model


def times(model: nhbm.Model, n: int) -> np.ndarray:
    """Of n solutions [us], sorted; without the dataset."""
    session = nhbm.Session()
    model.set("harmonics", order=7)
    session.read(model.to_namelist())
    frequency = session.parameter("tones%frequency")
    session.solve()
    found = np.zeros(n)
    for k, value in enumerate(0.9 + 1e-4 * np.sin(0.1 * np.arange(n))):
        start = time.process_time_ns()
        session.set_parameter(frequency, value)
        session.solve(warm=True)
        found[k] = time.process_time_ns() - start
    return np.sort(found) / 1000


def main() -> None:
    print("| solution | least [us] | median [us] |\n|---|---|---|")
    off = {"method": "off"}
    for name, groups in {
        "with error estimate": {"stability": off},
        "with error estimate and stability": {},
        "alone": {"stability": off, "error_estimate": {"is_on": False}},
    }.items():
        model = oscillator(**groups)
        model.law("cubic_spring", "x1", stiffness=0.1)
        found = times(model, 5000)
        print(f"| {name} | {found[0]:.1f} | {np.median(found):.1f} |", flush=True)
    law = nhbm.law(lambda q, v, p: p[0] * q * q * q, velocity=False, odd=True)
    laws = {"the catalogue": ("cubic_spring", {"stiffness": 0.1}), "NumPy": (law, {"parameters": [0.1]})}
    try:
        from nhbm.numba_laws import compiled

        cubic = (lambda q, v, p: p[0] * q * q * q, lambda q, v, p: (3 * p[0] * q * q, 0.0))
        force = compiled(*cubic, velocity=False, odd=True, degree=3)
        laws["Numba"] = force, {"parameters": [0.1]}
    except ImportError:
        pass
    for name, (law, keys) in laws.items():
        model = oscillator(stability=off, sampling={"samples": 4096})
        model.law(law, "x1", **keys)
        found = times(model, 300)
        print(f"| 4,096 samples, law of {name} | {found[0]:.1f} | {np.median(found):.1f} |", flush=True)
    print_models()


def processor(who: int = resource.RUSAGE_SELF) -> float:
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def line(name: str, call: Callable[[], object], n: int = 1, rounds: int = 5, who: int = resource.RUSAGE_SELF) -> None:
    """A row: processor time of a call, least and median of some rounds of n calls."""
    call()
    found = []
    for _ in range(rounds):
        start = processor(who)
        for _ in range(n):
            call()
        found.append(1e6 * (processor(who) - start) / n)
    print(f"| {name} | {min(found):.1f} | {statistics.median(found):.1f} |", flush=True)


def command(text: str, folder: str) -> Callable[[], object]:
    program = os.environ.get("NHBM", str(ROOT / "build" / "release" / "bin" / "nhbm"))
    path = Path(folder) / "model.nml"
    path.write_text(text)
    words = [program, "solve", str(path), "--overwrite", "--quiet"]
    return lambda: subprocess.run(words, cwd=folder, stdout=subprocess.DEVNULL, check=True)


def print_models() -> None:
    """Operations of a model, with their datasets."""
    library = "import nhbm; nhbm.Model"
    children = resource.RUSAGE_CHILDREN
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path[:2])}
    line("import of xarray", lambda: subprocess.run([sys.executable, "-c", "import xarray"], check=True), who=children)
    line("import of nhbm", lambda: subprocess.run([sys.executable, "-c", library], env=env, check=True), who=children)

    def built() -> nhbm.Model:
        model = oscillator(harmonics={"order": 7})
        model.law("cubic_spring", "x1", stiffness=0.1, label="spring")
        return model

    def of_ten() -> nhbm.Model:
        model = built()
        for number in range(6):
            model.law("cubic_spring", "x1", stiffness=0.01, label=f"spring_{number}")
        return model

    line("model of four statements", built, 20)
    line("model of ten statements", of_ten, 20)
    line("model of ten statements, and its first solution", lambda: of_ten().solve(), 20)
    model = of_ten()
    line("a further solution of it", model.solve, 100)
    model = built()
    session = model._begin(nhbm.model.request())
    line("solve in the library", session.solve, 100)
    line("model solve", model.solve, 100)
    line("model response", lambda: model.response("x1 (1)"), 100)
    by = {"by": ["law(spring)%stiffness"], "of": "x1 (1)"}
    session = model._begin(nhbm.model.request(gradient=by))
    session.solve()
    line("gradient in the library", lambda: session.solve(warm=True, points=0), 100)
    line("model gradient", lambda: model.gradient("x1 (1)", ["spring.stiffness"]), 100)
    values = np.linspace(0.5, 2.0, 1000)
    line("model sweep of a thousand points", lambda: model.sweep({"tones[0]": values}))
    line("model sweep of numbers", lambda: model.sweep({"tones[0]": values}, of="x1 (1)"))
    line("model curve", lambda: model.curve("tones[0]", 0.5, 2.0))
    text = model.to_namelist()
    sweep = "&sweep parameter = 'tones%frequency', from = 0.5, to = 2, n = 1000 /\n"
    curve = "&curve parameter = 'tones%frequency', from = 0.5, to = 2 /\n"
    with tempfile.TemporaryDirectory() as folder:
        line("sweep of the command", command(text + sweep, folder), who=children)
        line("curve of the command", command(text + curve, folder), who=children)
    model["tones[0]"] = 1.2
    session = model._begin(nhbm.model.request())
    line("census in the library", lambda: session.take_census(200, 1, 0.0))
    line("model census", model.census)


if __name__ == "__main__":
    main()
