"""Vibrations of structures with contact, friction and other nonlinear laws under several tones: models that are solved in process,
finite element structures, and their files."""

from typing import TYPE_CHECKING, Any

from nhbm.errors import ModelError

if TYPE_CHECKING:  # static checks know the types of what is imported later
    from nhbm.builders import Beam as Beam
    from nhbm.builders import Chain as Chain
    from nhbm.builders import Jeffcott as Jeffcott
    from nhbm.builders import Matrices as Matrices
    from nhbm.builders import ModalBeam as ModalBeam
    from nhbm.builders import RotorStator as RotorStator
    from nhbm.errors import Implausible as Implausible
    from nhbm.errors import Jump as Jump
    from nhbm.errors import NotConverged as NotConverged
    from nhbm.fitting import Fit as Fit
    from nhbm.fitting import compare_fits as compare_fits
    from nhbm.fitting import fit as fit
    from nhbm.importing import import_rotor as import_rotor
    from nhbm.importing import import_structure as import_structure
    from nhbm.keys import input_keys as input_keys
    from nhbm.laws import Step as Step
    from nhbm.laws import law as law
    from nhbm.measured import backbone as backbone
    from nhbm.model import Gradient as Gradient
    from nhbm.model import Model as Model
    from nhbm.peaks import Peak as Peak
    from nhbm.peaks import PeakGradient as PeakGradient
    from nhbm.results import open_dataset as open_dataset
    from nhbm.rotors import Rotor as Rotor
    from nhbm.session import Session as Session
    from nhbm.structure import Structure as Structure
    from nhbm.universal_files import read_uff as read_uff

__version__ = "0.1.0"
_LATER = {  # what needs NumPy and more is imported at the first use
    "Gradient": "model", "Model": "model", "Implausible": "errors", "Jump": "errors", "NotConverged": "errors",
    "Peak": "peaks", "PeakGradient": "peaks",
    "open_dataset": "results",
    "Step": "laws", "law": "laws",
    "backbone": "measured",
    "Fit": "fitting", "compare_fits": "fitting", "fit": "fitting",
    "Beam": "builders", "Chain": "builders",
    "Jeffcott": "builders", "Matrices": "builders", "ModalBeam": "builders", "RotorStator": "builders", "Rotor": "rotors",
    "Session": "session", "Structure": "structure", "import_rotor": "importing", "import_structure": "importing",
    "input_keys": "keys", "read_uff": "universal_files",
}  # fmt: skip
__all__ = ["ModelError", "__version__", *_LATER]


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        import difflib

        close = difflib.get_close_matches(name, _LATER, 1)
        raise AttributeError(f"module 'nhbm' has no attribute '{name}'" + (f"; did you mean '{close[0]}'?" if close else ""))
    import importlib

    return getattr(importlib.import_module(f"nhbm.{_LATER[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
