"""Vibrations of structures with contact, friction and other nonlinear laws under several tones: models that are solved in process,
finite element structures, and their files."""

from typing import Any

from nhbm.errors import ModelError

__version__ = "0.1.0"
_LATER = {  # what needs NumPy and more is imported at the first use
    "Gradient": "model", "Model": "model", "Implausible": "errors", "NotConverged": "errors", "Peak": "model", "PeakGradient": "model",
    "open_dataset": "dataset",
    "law": "laws",
    "Fit": "fitting", "fit": "fitting",
    "Beam": "groups", "Chain": "groups",
    "Jeffcott": "groups", "Matrices": "groups", "ModalBeam": "groups", "RotorStator": "groups", "Rotor": "rotors",
    "Session": "session", "Structure": "structure", "input_keys": "keys",
}  # fmt: skip
__all__ = ["ModelError", "__version__", *_LATER]


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'nhbm' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(f"nhbm.{_LATER[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
