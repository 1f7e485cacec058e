"""Pictures of result files, one module for each family; every `draw_*` returns a Figure and needs no display."""

from .animation import hypertime_in_motion, save_animation, structure_in_motion
from .bench import draw_bench
from .contact import draw_contact_time, draw_patch
from .correction import draw_correction
from .deflection import draw_deflection
from .heat_map import draw_map
from .motion import draw_orbit, draw_surface
from .multipliers import draw_multipliers
from .response import draw_response, write_response
from .rotor import draw_rotor
from .spectrum import draw_spectrum
from .style import relabel, save
from .time_history import draw_time
from .waterfall import draw_waterfall
from .work_precision import Errors, draw_convergence, draw_cost, draw_work_precision

__all__ = [
    "Errors",
    "draw_bench",
    "draw_contact_time",
    "draw_convergence",
    "draw_correction",
    "draw_cost",
    "draw_deflection",
    "draw_map",
    "draw_multipliers",
    "draw_orbit",
    "draw_patch",
    "draw_response",
    "draw_rotor",
    "draw_spectrum",
    "draw_surface",
    "draw_time",
    "draw_waterfall",
    "draw_work_precision",
    "hypertime_in_motion",
    "relabel",
    "save",
    "save_animation",
    "structure_in_motion",
    "write_response",
]
