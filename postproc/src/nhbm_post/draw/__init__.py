"""Pictures of result files and plans, one module a family; every `draw_*` returns a Figure and needs no display."""

from .correction import draw_correction
from .plan import draw_plan
from .response import draw_response
from .rotor import draw_rotor
from .spectrum import draw_spectrum
from .style import save
from .time_history import draw_time

__all__ = ["draw_correction", "draw_plan", "draw_response", "draw_rotor", "draw_spectrum", "draw_time", "save"]
