"""Write the small data sets that come with slamcli: ``python datasets/generate.py [FOLDER]``.

Each file is a simulated robot with Gaussian noise whose inverse covariance is written as the
information, so an optimized graph has a chi2 near its degrees of freedom. The vertices are what
odometry alone says. Only random numbers come from numpy; the rest is scalar arithmetic,
rounded to 1e-9 on writing, so that the bytes are the same on every machine.

Units are metres and radians. A measurement is always pose j in the frame of pose i.
"""

import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

Pose2 = tuple[float, float, float]  # x y theta
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x y z w
Pose3 = tuple[Vector3, Quaternion]


# --- SE(2) ---


def compose2(a: Pose2, b: Pose2) -> Pose2:
    """Return a * b: b, given in the frame of a, in the frame of a's parent."""
    c, s = math.cos(a[2]), math.sin(a[2])
    theta = math.remainder(a[2] + b[2], math.tau)
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], theta


def between2(a: Pose2, b: Pose2) -> Pose2:
    """Return a^-1 * b."""
    return *to_frame2(a, b[0], b[1]), math.remainder(b[2] - a[2], math.tau)


def to_frame2(a: Pose2, x: float, y: float) -> tuple[float, float]:
    """Return the point (x, y) in the frame of a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = x - a[0], y - a[1]
    return c * dx + s * dy, c * dy - s * dx


# --- SE(3), quaternions in file order x y z w ---


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product, with w >= 0."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    return (x, y, z, w) if w >= 0 else (-x, -y, -z, -w)


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return -q[0], -q[1], -q[2], q[3]


def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """Return v + 2 u x (u x v + w v), where u is the vector part of q."""
    (x, y, z, w), (a, b, c) = q, v
    p = y * c - z * b + w * a
    r = z * a - x * c + w * b
    s = x * b - y * a + w * c
    return a + 2 * (y * s - z * r), b + 2 * (z * p - x * s), c + 2 * (x * r - y * p)


def exponential(v: Vector3) -> Quaternion:
    """Return the quaternion of a rotation vector."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    k = math.sin(angle / 2) / angle if angle > 0 else 0.5
    return k * v[0], k * v[1], k * v[2], math.cos(angle / 2)


def compose3(a: Pose3, b: Pose3) -> Pose3:
    """Return a * b."""
    (x, y, z), (dx, dy, dz) = a[0], rotate(a[1], b[0])
    return (x + dx, y + dy, z + dz), multiply(a[1], b[1])


def between3(a: Pose3, b: Pose3) -> Pose3:
    """Return a^-1 * b."""
    (ax, ay, az), (bx, by, bz) = a[0], b[0]
    q = conjugate(a[1])
    return rotate(q, (bx - ax, by - ay, bz - az)), multiply(q, b[1])


# --- noise and text ---


class Noise:
    """Seeded random numbers, as Python floats."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.Generator(np.random.PCG64(seed))

    def uniform(self) -> float:
        """Return a number in [0, 1)."""
        return float(self._rng.random())

    def normal(self, sigma: float) -> float:
        """Return a Gaussian number of mean 0."""
        return sigma * float(self._rng.standard_normal())

    def pose2(self, z: Pose2, sigmas: Vector3) -> Pose2:
        """Return z * n, where n is noise in the frame of z, as in g2o's error z^-1 * h."""
        return compose2(z, (self.normal(sigmas[0]), self.normal(sigmas[1]), self.normal(sigmas[2])))

    def pose3(self, z: Pose3, sigma_t: float, sigma_r: float) -> Pose3:
        """Return z * n; sigma_r is per axis of the rotation vector."""
        t = self.normal(sigma_t), self.normal(sigma_t), self.normal(sigma_t)
        r = self.normal(sigma_r), self.normal(sigma_r), self.normal(sigma_r)
        return compose3(z, (t, exponential(r)))


def line(tag: str, ids: Iterable[int], *numbers: float) -> str:
    """Return one line of a file; adding 0.0 turns -0 into 0."""
    return " ".join([tag, *map(str, ids), *(f"{round(v, 9) + 0.0:.9g}" for v in numbers)])


def diagonal(values: list[float]) -> list[float]:
    """Return the upper triangle, row by row, of a diagonal matrix."""
    n = len(values)
    return [values[i] if i == j else 0.0 for i in range(n) for j in range(i, n)]


def weights(sigmas: Iterable[float]) -> list[float]:
    """Return 1 / sigma^2 of each."""
    return [1 / (s * s) for s in sigmas]


# --- the data sets: each yields the lines of a file ---


def manhattan(seed: int, poses: int = 400, half: int = 8) -> Iterator[str]:
    """Walk 1 m steps on a square of streets; recognise some of the places met again."""
    noise = Noise(seed)
    odometry_sigmas, closure_sigmas = (0.05, 0.05, 0.01), (0.05, 0.05, 0.02)
    steps = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by heading, in quarter turns
    x = y = heading = 0
    truth: list[Pose2] = [(0.0, 0.0, 0.0)]
    guess = truth[:]
    edges: list[str] = []
    for j in range(1, poses):
        x, y = x + steps[heading][0], y + steps[heading][1]
        u = noise.uniform()
        heading = (heading + (1 if u < 0.15 else 3 if u < 0.3 else 0)) % 4
        while max(abs(x + steps[heading][0]), abs(y + steps[heading][1])) > half:
            heading = (heading + (1 if noise.uniform() < 0.5 else 3)) % 4
        truth.append((float(x), float(y), heading * math.pi / 2))
        z = noise.pose2(between2(truth[j - 1], truth[j]), odometry_sigmas)
        guess.append(compose2(guess[j - 1], z))
        edges.append(line("EDGE_SE2", (j - 1, j), *z, *diagonal(weights(odometry_sigmas))))
        for i in range(j - 10):
            near = abs(truth[i][0] - x) + abs(truth[i][1] - y) <= 1
            if near and noise.uniform() < 0.21:
                z = noise.pose2(between2(truth[i], truth[j]), closure_sigmas)
                edges.append(line("EDGE_SE2", (i, j), *z, *diagonal(weights(closure_sigmas))))
    yield from (line("VERTEX_SE2", (k,), *pose) for k, pose in enumerate(guess))
    yield from edges


def sphere(seed: int, rings: int = 20, per_ring: int = 20, radius: float = 10.0) -> Iterator[str]:
    """Spiral up a sphere, with an edge to the pose one ring above each."""
    noise = Noise(seed)
    sigma_t, sigma_r = 0.05, 0.01
    # g2o's rotation error is the vector part of a quaternion, half the rotation vector.
    information = diagonal(weights([sigma_t] * 3 + [sigma_r / 2] * 3))
    poses = rings * per_ring
    truth: list[Pose3] = []
    for k in range(poses):
        longitude, latitude = math.tau * k / per_ring, math.pi * (k / (poses - 1) - 0.5)
        q = multiply(exponential((0.0, 0.0, longitude)), exponential((0.0, -latitude, 0.0)))
        truth.append((rotate(q, (radius, 0.0, 0.0)), q))
    guess = truth[:1]
    edges: list[str] = []
    for j in range(1, poses):
        for i in (j - 1, j - per_ring):
            if i < 0:
                continue
            z = noise.pose3(between3(truth[i], truth[j]), sigma_t, sigma_r)
            edges.append(line("EDGE_SE3:QUAT", (i, j), *z[0], *z[1], *information))
            if i == j - 1:
                guess.append(compose3(guess[i], z))
    yield from (line("VERTEX_SE3:QUAT", (k,), *t, *q) for k, (t, q) in enumerate(guess))
    yield from edges


def landmarks(seed: int, poses: int = 100, count: int = 30, radius: float = 10.0) -> Iterator[str]:
    """Drive round a circle lined with landmarks; beyond 4 m only their bearing is seen, rarely."""
    noise = Noise(seed)
    sigmas, sigma_xy, sigma_bearing = (0.05, 0.05, 0.01), 0.1, 0.02
    places: list[tuple[float, float]] = []
    for k in range(count):
        angle = math.tau * (k + noise.uniform()) / count
        r = radius + (1.0 + 2.0 * noise.uniform()) * (1 if k % 2 else -1)
        places.append((r * math.cos(angle), r * math.sin(angle)))
    truth: list[Pose2] = []
    guess: list[Pose2] = []
    first_seen: dict[int, tuple[float, float]] = {}
    edges: list[str] = []
    for j in range(poses):
        angle = math.tau * j / poses
        truth.append((radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2))
        if j == 0:
            guess.append(truth[0])
        else:
            z = noise.pose2(between2(truth[j - 1], truth[j]), sigmas)
            guess.append(compose2(guess[j - 1], z))
            edges.append(line("EDGE_SE2", (j - 1, j), *z, *diagonal(weights(sigmas))))
        for k, place in enumerate(places):
            x, y = to_frame2(truth[j], *place)
            distance2 = x * x + y * y
            if distance2 < 16:
                x, y = x + noise.normal(sigma_xy), y + noise.normal(sigma_xy)
                information = diagonal(weights([sigma_xy] * 2))
                edges.append(line("EDGE_SE2_XY", (j, poses + k), x, y, *information))
                first_seen.setdefault(k, compose2(guess[j], (x, y, 0.0))[:2])
            elif k in first_seen and distance2 < 64 and noise.uniform() < 0.2:
                bearing = math.remainder(math.atan2(y, x) + noise.normal(sigma_bearing), math.tau)
                information = weights([sigma_bearing])
                edges.append(line("EDGE_BEARING_SE2_XY", (j, poses + k), bearing, *information))
    yield from (line("VERTEX_SE2", (k,), *pose) for k, pose in enumerate(guess))
    yield from (line("VERTEX_XY", (poses + k,), *first_seen[k]) for k in sorted(first_seen))
    yield from edges


def square_toro(seed: int, poses: int = 40, side: int = 5) -> Iterator[str]:
    """Drive twice round a square, matching the second lap to the first; in TORO's format."""
    noise = Noise(seed)
    sigmas = (0.05, 0.02, 0.01)  # sideways slip is less: a wrong order of the weights shows
    lap = 4 * side
    w = weights(sigmas)
    information = w[0], 0.0, w[1], w[2], 0.0, 0.0  # TORO: I11 I12 I22 I33 I13 I23
    truth: list[Pose2] = [(0.0, 0.0, 0.0)]
    guess = truth[:]
    edges: list[str] = []
    for j in range(1, poses):
        step = 1.0, 0.0, math.pi / 2 if j % side == 0 else 0.0
        truth.append(compose2(truth[j - 1], step))
        for i in (j - 1, j - lap):
            if i < 0:
                continue
            x, y, theta = between2(truth[i], truth[j])
            # TORO's error is that of the numbers in the record: the noise is in the frame of pose i
            z = x + noise.normal(sigmas[0]), y + noise.normal(sigmas[1]), theta + noise.normal(sigmas[2])
            edges.append(line("EDGE2", (i, j), *z, *information))
            if i == j - 1:
                guess.append(compose2(guess[i], z))
    yield from (line("VERTEX2", (k,), *pose) for k, pose in enumerate(guess))
    yield from edges


DATASETS = {
    "manhattan_small.g2o": (manhattan, 8),
    "sphere_small.g2o": (sphere, 11),
    "landmarks_small.g2o": (landmarks, 3),
    "square_toro.graph": (square_toro, 8),
}


def main(folder: Path) -> None:
    """Write every data set into the folder."""
    for name, (make, seed) in DATASETS.items():
        lines = [f"# {name}: generated by datasets/generate.py with seed {seed}", *make(seed)]
        (folder / name).write_bytes(("\n".join(lines) + "\n").encode("ascii"))
        print(f"{folder / name}: {len(lines) - 1} lines")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
