"""Frequency and damping of the BARC over the amplitude: its bolts as friction pairs in the place of rigid ties.

The BARC (Box Assembly with Removable Component, https://wiki.sem.org/wiki/BARC) is the bolted structure on which the structural
dynamics community compares its methods. The package visualdynamics builds it from plates, with each bolt as rigid links of the
nodes
that it clamps to the part below. Here each of these nodes may slide in its plane, against friction; where all stick and the contact
is stiff, the modes are those of the rigid links.

usage: python barc.py [PICTURE.png]          needs visualdynamics 0.1.0a74 (Python 3.12 or newer)
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from visualdynamics.demo import barc

import nhbm
import nhbm.reduction

SIZE = 0.25  # of an element [in]
PER_NODE = 6  # three displacements and three rotations
SLIDING = (0, 2)  # x and z: the bolts stand along y
CONTACT = 2e7  # tangential stiffness of a node that a bolt clamps [N/m]
TENSION, FRICTION = 300.0, 0.2  # of a bolt that is tightened by hand [N], and the coefficient
SUPPORT = 2 * np.pi * 5.0  # frequency of the soft springs that hold it [rad/s]
DAMPING = 2e-3  # ratio of each mode without slip
FORCES = [0.5, 1.0, 2.0, 4.0, 8.0]  # on the middle of the beam, along y [N]


def clamped(ties: sp.csr_matrix) -> np.ndarray:
    """The nodes whose motion follows from those of others, from 0: rows of the constraint that are no unit rows of their own."""
    owner: dict[int, int] = {}
    follows = set()
    for row in range(ties.shape[0]):
        columns, values = ties.indices[ties.indptr[row] : ties.indptr[row + 1]], ties.data[ties.indptr[row] : ties.indptr[row + 1]]
        if len(columns) == 1 and values[0] == 1.0 and columns[0] not in owner:
            owner[columns[0]] = row
        else:
            follows.add(row // PER_NODE)
    return np.array(sorted(follows))


def structure(n_modes: int = 30) -> nhbm.Structure:
    """The BARC on soft springs, reduced to how far each clamped node has slid (`s12.x`, `s12.z`), a driving point and modes."""
    model = barc.build(SIZE)
    mass, stiffness = model.sparse_matrices()
    ties = sp.csr_matrix(model.constraint_transform(sparse=True))
    nodes = clamped(ties)
    rows = np.concatenate([PER_NODE * nodes + axis for axis in SLIDING])
    slides = sp.csr_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(ties.shape[0], len(rows)))
    whole = sp.hstack([ties, slides]).tocsr()
    mass, stiffness = (sp.csr_matrix(whole.T @ matrix @ whole) for matrix in (mass, stiffness))
    labels = [f"u{i + 1}" for i in range(ties.shape[1])]
    labels[driven(model, ties)] = "drive"
    labels += [f"s{node + 1}.{'xyz'[axis]}" for axis in SLIDING for node in nodes]
    made = nhbm.Structure((mass + mass.T) / 2, (stiffness + stiffness.T) / 2 + SUPPORT**2 * (mass + mass.T) / 2, labels=labels)
    return nhbm.reduction.reduce(made, ["drive", *labels[ties.shape[1] :]], n_modes=n_modes, method="craig-bampton")


def driven(model, ties: sp.csr_matrix) -> int:
    """The coordinate of the displacement along y of the node nearest to the middle of the beam."""
    places = np.array([model.position(number) for number in model.node_ids])
    inch = 0.0254
    node = int(np.argmin(np.linalg.norm(places - inch * np.array([0.0, barc.BEAM_Y, 1.5]), axis=1)))
    return int(ties[PER_NODE * node + 1].indices[0])


def frequencies(made: nhbm.Structure, contact: float, n: int = 5) -> np.ndarray:
    """Elastic natural frequencies where all nodes stick with this stiffness [Hz]."""
    springs = sp.diags([contact * label.startswith("s") for label in made.labels])
    squares = eigh((made.stiffness + springs).toarray(), made.mass.toarray(), eigvals_only=True)
    found = np.sqrt(np.maximum(squares - SUPPORT**2, 0.0)) / (2 * np.pi)
    return found[found > 1.0][:n]


def model(made: nhbm.Structure) -> nhbm.Model:
    """The BARC shaken in the middle of its beam, with the friction of all bolts."""
    shaken = nhbm.Model(made, tones=[2 * np.pi * 196.0])
    shaken.set("structure", damping_mass=2 * DAMPING * 2 * np.pi * 196.0)
    shaken.set("stability", method="off")
    shaken.load("drive", 1, cos=FORCES[0])
    nodes = [label[1:-2] for label in made.labels if label.endswith(".x")]
    limit = FRICTION * TENSION * len(barc.BOLTS) / len(nodes)  # the bolts press their nodes equally
    for node in nodes:
        shaken.law("jenkins_2d", f"s{node}.x", second_dofs=f"s{node}.z", stiffness=CONTACT, limit=limit, label=f"node {node}")
    return shaken


def backbone(made: nhbm.Structure):
    """Motions at phase resonance of the first elastic mode, over the force. Beyond 8 N whole joints slide, and so many modes take
    part that the phase of one point no longer tells the frequency of one."""
    stuck = 2 * np.pi * frequencies(made, CONTACT, 1)[0]
    found = model(made).curve(
        "load(1)%cos", FORCES[0], FORCES[-1], values=FORCES[1:-1], follow="resonance", resonance_of="drive (1)",
        over="tones%frequency", over_from=1.002 * stuck, over_to=0.9 * stuck, order=5,
    )  # fmt: skip
    omega, rate = found["frequency"][:, 0], found.nhbm.details["equivalent_damping"]
    return found.assign(amplitude=found.nhbm.amplitude("drive"), omega=omega, ratio=rate / omega)


def draw(found):
    """Frequency and damping ratio over the amplitude of the driven point."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(5.5, 5.0), sharex=True, layout="constrained")
    above.semilogx(1e6 * found["amplitude"], found["omega"] / (2 * np.pi), ".-")
    below.loglog(1e6 * found["amplitude"], 100 * found["ratio"], ".-")
    above.set(ylabel="Natural frequency [Hz]")
    below.set(ylabel="Damping ratio [%]", xlabel="Amplitude of the beam's middle [µm]")
    for ax in (above, below):
        ax.grid(color="0.9", which="both")
    return figure


def main(picture: str = "barc.png") -> None:
    made = structure()
    for contact in (1e12, CONTACT):
        print(f"{contact:.0e} N/m:", *frequencies(made, contact).round(2), "Hz")
    found = backbone(made)
    print("force [N]  amplitude [um]  frequency [Hz]  damping [%]  estimated error")
    for k in range(found.sizes["point"]):
        at = found.isel(point=k)
        print(f"{float(at['load_1_cos']):9.3f}  {1e6 * float(at['amplitude']):14.3f}  {float(at['omega']) / (2 * np.pi):14.4f}"
              f"  {100 * float(at['ratio']):11.4f}  {float(at['truncation_estimate']):15.0e}")  # fmt: skip
    draw(found).savefig(picture, dpi=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
