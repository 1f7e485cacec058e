"""Random keys of `&curve` for a random model."""

from __future__ import annotations

import numpy as np
from point_parts.models import Model

TOLERANCES = (1e-2, 3e-3, 1e-3)


def curve_of(model: Model, draw: np.random.Generator) -> tuple[str, float | None]:
    """The group of a curve over the frequency, a load, or the place of a stop, and the tolerance to which it is followed, if
    any."""
    n_tones = len(model.omega)
    lowest = float(np.sort(model.modes()[0])[0])
    first, last = 0.4 * lowest, 2.3 * lowest
    path = "tones%frequency" if n_tones == 1 else "tones%frequency(1)"
    chosen = draw.random()
    gap = next((law.parameters[1] for law in model.laws[:1] if "elastic_stop" in law.text(model.labels)), None)
    if chosen < 0.2 and not model.moves:
        cosine = next(float(c) for c in model.loads[0][1] if c)
        path, first, last = "load(1)%cos", 0.1 * cosine, 3.0 * cosine
    elif chosen < 0.35 and gap is not None:
        path, first, last = "law(1)%gap", 2.0 * gap, 0.2 * gap
    if draw.random() < 0.3:
        first, last = last, first
    keys = [f"parameter='{path}'", f"from={first!r}", f"to={last!r}", f"points={int(draw.choice([150, 300]))}"]
    responses = [f"'{model.labels[draw.integers(len(model.labels))]}{part}'" for part in _parts(n_tones, draw)]
    keys.append(f"peak_of={responses[0]}" + (f", {responses[1]}" if draw.random() < 0.4 and responses[1] != responses[0] else ""))
    if draw.random() < 0.4:
        keys.append(f"minimum_of={responses[2]}")
    if draw.random() < 0.4:
        keys.append("values=" + ", ".join(repr(float(v)) for v in first + (last - first) * draw.uniform(0.05, 0.95, 2)))
    if draw.random() < 0.3:
        amplitude = float(np.max(np.abs(model.loads[0][1]) + np.abs(model.loads[0][2])) / np.max(np.diag(model.stiffness)))
        keys.append(f"amplitude_of={responses[3]}, amplitudes={amplitude * draw.uniform(0.5, 3.0)!r}")
    if draw.random() < 0.3:
        keys.append("jump=.true.")
    if draw.random() < 0.3:
        keys.append(f"max_step={float(draw.choice([0.02, 0.1]))!r}")
    if n_tones > 1 and path.startswith("tones") and draw.random() < 0.5:
        keys.append("tie='ratio'")
    tolerance = float(draw.choice(TOLERANCES)) if draw.random() < 0.5 else None
    return f"&curve {', '.join(keys)} /\n", tolerance


def _parts(n_tones: int, draw: np.random.Generator) -> list[str]:
    """What of a degree of freedom is a response: a harmonic, or nothing for the whole oscillation."""
    tuples = [" (" + ",".join(str(int(i == m)) for i in range(n_tones)) + ")" for m in range(n_tones)]
    return [str(draw.choice(["", *tuples])) for _ in range(4)]
