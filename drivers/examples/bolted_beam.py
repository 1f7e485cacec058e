"""Frequency and damping of a bolted lap joint over the amplitude: a beam with the dimensions of the Brake-Reuss beam.

Two half beams of steel, together 0.72 m long and 25.4 mm square, overlap by 120 mm, where each is half as high; three M8 bolts
press them together. Plane stress, quadratic elements; friction under the instantaneous normal force at each pair of nodes.

usage: python bolted_beam.py [PICTURE.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import skfem

import nhbm
import nhbm.assembly
import nhbm.reduction

LENGTH, SIDE, LAP = 0.72, 0.0254, 0.12  # [m]
YOUNG, POISSON, DENSITY = 1.93e11, 0.29, 7850.0
BOLTS, WASHER = (0.33, 0.36, 0.39), 0.016  # positions along the beam and diameter [m]
TENSION = 12e3  # of each bolt [N]
CONTACT = 1e12  # stiffness of the interface, normal and tangential [N/m3]
FRICTION = 0.2
CROWN = 1e-5  # gap at both ends of the lap: measured interfaces are not flat [m]
ELEMENTS = 32  # along the lap
LOADS = [0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 4.0]  # at the right end [N]
END = "upper_end.z"  # where the beam is shaken
DAMPING = 1.0  # of all motions, beside that of friction: proportional to the mass [1/s]


def half(is_upper: bool) -> nhbm.Structure:
    """The lower half beam, on the left; turned by half a turn the upper one."""
    start = (LENGTH - LAP) / 2  # of the lap
    x = np.concatenate([np.linspace(0.0, start, 16), np.linspace(start, start + LAP, ELEMENTS + 1)[1:]])
    mesh = skfem.MeshQuad.init_tensor(x, np.linspace(-SIDE / 2, SIDE / 2, 5))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.flatnonzero((middle[0] < start) | (middle[1] < 0.0)))
    if is_upper:
        mesh = skfem.MeshQuad(np.array([[LENGTH], [0.0]]) - mesh.p, mesh.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    plane, shear = YOUNG / (1 - POISSON**2), YOUNG / (2 * (1 + POISSON))

    def energy(u, v, _):
        a, b = u.grad, v.grad
        normal = a[0, 0] * b[0, 0] + a[1, 1] * b[1, 1] + POISSON * (a[0, 0] * b[1, 1] + a[1, 1] * b[0, 0])
        return SIDE * (plane * normal + shear * (a[0, 1] + a[1, 0]) * (b[0, 1] + b[1, 0]))

    stiffness = skfem.BilinearForm(energy).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: SIDE * DENSITY * (u[0] * v[0] + u[1] * v[1])).assemble(basis)
    dofs = np.hstack([basis.nodal_dofs, basis.facet_dofs, basis.interior_dofs])  # (2, n_nodes)
    x, z = basis.doflocs[:, dofs[0]]
    order, n_nodes, tiny = dofs.T.ravel(), dofs.shape[1], 1e-9
    washers = [np.flatnonzero((abs(x - bolt) < WASHER / 2) & (abs(z) > SIDE / 2 - tiny)) for bolt in BOLTS]
    push = [np.full(len(nodes), (-1.0 if is_upper else 1.0) / len(nodes)) for nodes in washers]
    return nhbm.Structure(
        mass[order][:, order], stiffness[order][:, order],
        labels=[f"n{i + 1}.{d}" for i in range(n_nodes) for d in "xz"],
        node_numbers=np.arange(1, n_nodes + 1), coordinates=np.column_stack([x, np.zeros(n_nodes), z]),
        dof_node=np.repeat(np.arange(n_nodes), 2), dof_direction=list("xz" * n_nodes),
        sets={"face": np.flatnonzero((abs(2 * x - LENGTH) < LAP + tiny) & (abs(z) < tiny)),
              "end": np.flatnonzero((abs(2 * x - LENGTH) > LENGTH - tiny) & (abs(z) < tiny))},
        loads={"bolts": (2 * np.concatenate(washers) + 1, np.concatenate(push))},
    )  # fmt: skip


def beam() -> nhbm.Structure:
    """Both halves, in coordinates of which those of the interface are relative; `bolts` is 1 N in each bolt."""
    both = nhbm.assembly.assemble({"lower": half(False), "upper": half(True)})
    nhbm.assembly.add_pair(both, "joint", "lower_face", "upper_face")
    both.loads = {"bolts": tuple(np.concatenate(part) for part in zip(both.loads["lower_bolts"], both.loads["upper_bolts"]))}
    return nhbm.reduction.reduce(both, ["joint.x", "joint.z", END], n_modes=20)


def areas(structure: nhbm.Structure) -> np.ndarray:
    """What each pair of nodes stands for [m2]: quadratic shapes give two thirds of an element to its middle."""
    share = np.zeros(2 * ELEMENTS + 1)
    for k in range(ELEMENTS):
        share[2 * k : 2 * k + 3] += np.array([1.0, 4.0, 1.0]) / 6.0 * LAP / ELEMENTS * SIDE
    return share[np.argsort(np.argsort(positions(structure)))]


def positions(structure: nhbm.Structure) -> np.ndarray:
    """Of the pairs, from the middle of the lap [m]."""
    return structure.coordinates[structure.sets["joint"], 0] - LENGTH / 2


def model(structure: nhbm.Structure) -> nhbm.Model:
    """The beam in free flight, pressed together by the bolts and shaken at its right end."""
    made = nhbm.Model(structure, tones=[2 * np.pi * 165.0])
    made.set("structure", damping_mass=DAMPING)
    made.set("stability", method="off")
    made.load(vector="bolts", tuple_=0, cos=TENSION)
    made.load(END, 1, cos=1.0)
    pairs = zip(structure.sets["joint"], areas(structure), positions(structure))
    for k, (node, area, x) in enumerate(pairs):
        number, stiffness, gap = structure.node_numbers[node], CONTACT * area, CROWN * (2 * x / LAP) ** 2
        made.law("jenkins", f"n{number}.x", label=f"pair {k + 1}", stiffness=stiffness, friction_coefficient=FRICTION,
                 normal_dofs=[f"n{number}.z"], normal_stiffness=stiffness, preload=-stiffness * gap)  # fmt: skip
    return made


def backbone(structure: nhbm.Structure):
    """Motions at phase resonance of the first bending mode, over the force."""
    found = model(structure).curve(
        "load(2)%cos", LOADS[0], LOADS[-1], values=LOADS[1:-1], follow="resonance", resonance_of=f"{END} (1)",
        over="tones%frequency", over_from=1023.0, over_to=970.0, order=3,
    )  # fmt: skip
    omega, rate = found["frequency"][:, 0], found.nhbm.details["equivalent_damping"]
    return found.assign(amplitude=found.nhbm.amplitude(END), omega=omega, ratio=rate / omega)


def draw(found, checks=()):
    """Frequency and damping over the amplitude of the right end; each of `checks`: a label, rows of amplitude, omega and ratio."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(5.5, 5.0), sharex=True, layout="constrained")
    above.semilogx(1e6 * found["amplitude"], found["omega"] / (2 * np.pi), ".-", label="harmonic balance")
    below.loglog(1e6 * found["amplitude"], 100 * found["ratio"], ".-")
    for mark, (label, rows) in zip("ox", checks):
        amplitude, omega, ratio = np.transpose(rows)
        above.plot(1e6 * amplitude, omega / (2 * np.pi), mark, mfc="none", color="C1", label=label)
        below.plot(1e6 * amplitude, 100 * ratio, mark, mfc="none", color="C1")
    above.set(ylabel="Natural frequency [Hz]")
    below.set(ylabel="Damping ratio [%]", xlabel="Amplitude of the right end [µm]")
    above.legend(fontsize=8)
    for ax in (above, below):
        ax.grid(color="0.9", which="both")
    return figure


def main(picture: str = "bolted_beam.png") -> None:
    found = backbone(beam())
    print("force [N]  end [um]  frequency [Hz]  damping [%]  estimated error")
    for k in range(found.sizes["point"]):
        at = found.isel(point=k)
        print(f"{float(at['load_2_cos']):9.3f}  {1e6 * float(at['amplitude']):8.2f}  {float(at['omega']) / (2 * np.pi):14.3f}"
              f"  {100 * float(at['ratio']):11.4f}  {float(at['truncation_estimate']):15.0e}")  # fmt: skip
    draw(found).savefig(picture, dpi=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
