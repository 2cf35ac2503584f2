"""The numbers that appendix C prints: the kinetic energy and the torque of joint 1, term by term."""

from typing import NamedTuple

import numpy as np

import rne

SAMPLES = 5  # of each angle; enough, as no term has more than twice an angle
ANGLES = ("q2", "q3", "q4", "q5")  # on which M depends


class Term(NamedTuple):
    """A term of a sum: its coefficient [kg m^2] and the cosine or sine of k2 q2 + k3 q3 + k4 q4 + k5 q5."""

    entry: str  # factor of which joint velocities, such as "23" of q2' q3'
    k: tuple[int, int, int, int]
    function: str
    coefficient: float


def terms(text: str) -> tuple[Term, ...]:
    """Terms that are written one a line: entry, k2 to k5, function, coefficient."""
    rows = [line.split() for line in text.strip().splitlines()]
    return tuple(Term(e, (int(a), int(b), int(c), int(d)), function, float(x)) for e, a, b, c, d, function, x in rows)


# Left out, as they are damaged in the copy that was read: the constant of 11, the term of sin(q2 + q3) of 14, and every
# other term that is not whole there. A constant is the cosine of nothing.
KINETIC_ENERGY = terms(
    """
    11  1  0  0  0 sin  0.96474
    11  2  0  0  0 cos -1.122636
    11  0  1  0  0 sin -0.4284
    11  2  1  0  0 sin  0.4284
    11  1  1  0  0 cos  0.1666
    22  0  0  0  0 cos  2.8651695
    22  0  1  0  0 sin -0.8568
    22  0  0  0  1 cos  0.01102
    23  0  1  0  0 sin -0.8568
    23  0  0  0  1 cos  0.02204
    33  0  0  0  0 cos  0.5557455
    33  0  0  0  1 cos  0.01102
    44  0  0  0  0 cos  0.05609
    66  0  0  0  0 cos  0.000729
    11  0  1 -1  1 sin -0.001305
    11  0  1  1 -1 sin  0.001305
    11  1  1  1 -1 cos -0.0005075
    11  2  2 -1  2 cos  3.4e-05
    12  1  0 -1 -1 cos  0.00261
    12  1  0 -1  1 cos -0.00261
    12  1  0  1 -1 cos -0.00261
    12  1  0  1  1 cos  0.00261
    12  1  1 -1  2 sin  6.8e-05
    12  1  1  2 -2 sin -3.4e-05
    13  1  1 -1 -1 sin -0.002755
    13  1  1 -1  1 sin  0.002755
    13  1  1 -1  2 sin  6.8e-05
    13  1  1  1 -1 sin  0.002755
    13  1  1  2 -2 sin -3.4e-05
    13  1  1  2  2 sin -3.4e-05
    14  1  0 -1 -1 cos  0.00261
    14  1  0 -1  1 cos -0.00261
    14  1  1 -1 -1 sin -0.002755
    14  1  1 -1  1 sin  0.002755
    14  1  1  1  2 sin  6.8e-05
    15  0  0  1 -1 sin  0.001015
    15  0  0  1  1 sin  0.001015
    15  1  1 -1  0 sin -0.001001
    15  1  1  1 -1 sin  0.002755
    15  1  1  1  0 sin  0.001001
    23  0  0  0  2 cos  0.000136
    23  0  1  1 -1 sin  0.00261
    23  0  1  1  1 sin -0.00261
    24  0  0  1 -2 cos -0.000136
    25  0  0  1 -1 cos  0.00551
    25  0  0  1  0 cos  0.002002
    25  0  0  1  1 cos  0.00551
    25  0  1 -1 -1 sin -0.00261
    25  0  1  0 -1 sin  0.00522
    25  0  1  0  1 sin -0.00522
    25  0  1  1 -1 sin -0.00261
    34  0  0  1 -2 cos -0.000136
    """
)
TORQUE_OF_JOINT_1 = terms(
    """
    13  2  2  0  0 sin -0.999311
    13  2  1  0  0 cos  0.8568
    """
)
PRINTED = KINETIC_ENERGY + TORQUE_OF_JOINT_1


def samples() -> np.ndarray:
    """Positions with q2 to q5 at equal distances round the circle, shape (5, 5, 5, 5, 6) [rad]."""
    circle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    q = np.zeros((*[SAMPLES] * len(ANGLES), 6))
    q[..., 1:5] = np.stack(np.meshgrid(*[circle] * len(ANGLES), indexing="ij"), axis=-1)
    return q


def coefficients(values: np.ndarray, which: tuple[Term, ...]) -> np.ndarray:
    """Coefficients of some terms in a sum that is known at `samples()`, by Fourier's transform."""
    waves = np.fft.fftn(values) / values.size
    found = [waves[term.k] * (2 if any(term.k) else 1) for term in which]
    return np.array([x.real if term.function == "cos" else -x.imag for x, term in zip(found, which, strict=True)])


def ours(robot: rne.Robot) -> np.ndarray:
    """Coefficients of `PRINTED` by this package's mass matrix and Coriolis torques [kg m^2]."""
    q, e = samples(), np.eye(6)
    M = robot.mass_matrix(q)
    found = []
    for term in KINETIC_ENERGY:
        i, j = (int(digit) - 1 for digit in term.entry)
        found.append(coefficients(M[..., i, j] / (2 if i == j else 1), (term,))[0])
    together, *alone = (robot.coriolis_torque(q, np.broadcast_to(qd, q.shape)) for qd in (e[0] + e[2], e[0], e[2]))
    return np.r_[found, coefficients((together - sum(alone))[..., 0], TORQUE_OF_JOINT_1)]


def printed() -> np.ndarray:
    """Coefficients of `PRINTED` as the thesis has them [kg m^2]."""
    return np.array([term.coefficient for term in PRINTED])
