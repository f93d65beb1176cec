#!/usr/bin/env python3
"""Designs of the fuzzy-polynomial observer by CVXPY with Clarabel and SCS, beside ours, in one run.

    cargo build --release && python3 benches/peers/design.py [--alpha 18] [--mavobserver PATH]

The peers solve the paper's problems as it states them: 8 vertices of (20)-(23) for TS-8GD, 2 vertices of (14) and (15)
with full Gram matrices for SOS-2G. Ours uses the plant's symmetries, which changes no optimum. What Python lacks is
skipped, loudly. Times are those of a whole design: stating it, solving it, and for ours checking it.
"""

import argparse
import itertools
import json
import subprocess
import sys
import time
from collections import defaultdict

try:
    import cvxpy as cp
    import numpy as np
except ImportError as missing:
    sys.exit(f"SKIPPED: {missing}; needs cvxpy and numpy")

T, SIGMA, R2 = 0.005, 0.003, 7.5
GYRO = 4 * 54.945 * 10 * 6e-5 / 0.0552
SPEED = np.pi / 2


def scales(alpha):
    rate = np.sqrt(alpha / T)
    return np.diag([0.01, 0.01 * rate] * 3)


def linear(u):
    a = np.eye(6)
    for k in range(3):
        a[2 * k, 2 * k + 1] = T
    a[1, 3], a[3, 1] = T * GYRO * u, -T * GYRO * u
    return a


def plant(alpha):
    t = scales(alpha)
    ti = np.linalg.inv(t)
    c = np.zeros((3, 6))
    c[range(3), range(0, 6, 2)] = 1
    q = np.zeros((6, 3))
    q[range(1, 6, 2), range(3)] = 0.02 * T
    d = np.diag([0.001, 0.1] * 3) / 0.1
    return t, ti, c @ t / 0.01, ti @ q, d @ t


def eight_gains(alpha):
    """TS-8GD: Corollary 1."""
    t, ti, c, q, d = plant(alpha)
    p = cp.Variable((6, 6), symmetric=True)
    gamma, tau1, tau2 = cp.Variable(), cp.Variable(), cp.Variable()
    constraints = [p >> 0]
    zeros = lambda r, k: np.zeros((r, k))
    s2 = SIGMA**2 * t @ t
    for u, x2, x4 in itertools.product([1, -1], repeat=3):
        a = linear(u)
        a[1, 5], a[3, 5] = -T * SPEED * x4, T * SPEED * x2
        h = cp.Variable((6, 3))
        step = p @ (ti @ a @ t) - h @ c
        constraints += [
            cp.bmat([
                [p - d.T @ d - tau1 * s2, step.T, zeros(6, 3), zeros(6, 3), zeros(6, 6)],
                [step, p, p @ q, -h, p],
                [zeros(3, 6), (p @ q).T, gamma * np.eye(3), zeros(3, 3), zeros(3, 6)],
                [zeros(3, 6), -h.T, zeros(3, 3), gamma * np.eye(3), zeros(3, 6)],
                [zeros(6, 6), p, zeros(6, 3), zeros(6, 3), tau1 * (t @ t)],
            ]) >> 0,
            cp.bmat([
                [np.exp(-2 * alpha * T) * p - tau2 * s2, step.T, zeros(6, 6)],
                [step, p, p],
                [zeros(6, 6), p, tau2 * (t @ t)],
            ]) >> 0,
            step + step.T >> 0,
        ]
    return cp.Problem(cp.Minimize(gamma), constraints), gamma


def sums_of_squares(alpha):
    """SOS-2G: Theorem 1, without (16), which is inactive."""
    t, ti, c, q, d = plant(alpha)
    r = np.sqrt(R2)
    p = cp.Variable((6, 6), symmetric=True)
    gamma = cp.Variable()
    constraints = []
    xi, e, eta, w = range(0, 6), range(6, 12), range(12, 15), range(15, 21)
    es = [7, 9, 11]
    share = [t[i, i] / r for i in (1, 3, 5)]
    mono = lambda *v: tuple(sorted(v))

    def require(terms, linear_basis):
        s, m = cp.Variable((3, 3), PSD=True), cp.Variable((3, 3), PSD=True)
        for i, j in itertools.product(range(3), repeat=2):
            base = mono(es[i], es[j])
            terms[base] += [-s[i, j], -m[i, j]]
            for k in range(3):
                terms[mono(*base, eta[k], eta[k])] += [s[i, j]]
                terms[mono(*base, es[k], es[k])] += [m[i, j] * share[k] ** 2]
        basis = [(v,) for v in linear_basis] + [mono(a, b) for a in es for b in eta]
        basis += [mono(a, b) for a, b in itertools.combinations_with_replacement(es, 2)]
        gram = cp.Variable((len(basis), len(basis)), PSD=True)
        places = defaultdict(list)
        for (i, a), (j, b) in itertools.product(enumerate(basis), repeat=2):
            places[mono(*a, *b)].append((i, j))
        for key, at in places.items():
            rows, cols = zip(*at)
            constraints.append(cp.sum(gram[list(rows), list(cols)]) == sum(terms.get(key, [0])))

    for u in (1, -1):
        a = ti @ linear(u) @ t
        h = cp.Variable((6, 3))
        step = defaultdict(list)  # 2 xi'(P dA - H C e) + xi' P xi
        pa = p @ a - h @ c
        for i, j in itertools.product(range(6), repeat=2):
            step[mono(xi[i], e[j])].append(2 * pa[i, j])
            step[mono(xi[i], xi[j])].append(p[i, j])
            for row, (k, l), sign in ((1, (1, 2), -1), (3, (0, 2), 1)):
                if j == row:
                    weight = 2 * T * sign * r * r / t[row, row] * p[i, row]
                    step[mono(xi[i], eta[k], es[l])].append(weight * share[l])
                    step[mono(xi[i], eta[l], es[k])].append(weight * share[k])
                    step[mono(xi[i], es[k], es[l])].append(-weight * share[k] * share[l])
        dissipation = defaultdict(list, {k: list(v) for k, v in step.items()})
        pq = p @ q
        pd = p - d.T @ d
        for i in range(6):
            for j in range(3):
                dissipation[mono(xi[i], w[j])].append(2 * pq[i, j])
                dissipation[mono(xi[i], w[3 + j])].append(-2 * h[i, j])
            for j in range(6):
                dissipation[mono(e[i], e[j])].append(pd[i, j])
            dissipation[mono(w[i], w[i])].append(gamma)
        decay = defaultdict(list, {k: list(v) for k, v in step.items()})
        for i, j in itertools.product(range(6), repeat=2):
            decay[mono(e[i], e[j])].append(np.exp(-2 * alpha * T) * p[i, j])
        require(dissipation, [*xi, *e, *w])
        require(decay, [*xi, *e])
    return cp.Problem(cp.Minimize(gamma), constraints), gamma


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--alpha", type=float, default=18)
    parser.add_argument("--mavobserver", default="target/release/mavobserver")
    args = parser.parse_args()
    rows = []
    for method, build in (("TS-8GD", eight_gains), ("SOS-2G", sums_of_squares)):
        command = [args.mavobserver, "design", "fuzzy-polynomial", "--method", method, "--alpha", str(args.alpha), "--json"]
        begun = time.perf_counter()
        try:
            out = subprocess.run(command, capture_output=True, text=True, check=True)
            row = json.loads(out.stdout)["rows"][0]
            rows.append((method, "mavobserver", row["value"], time.perf_counter() - begun, "verified"))
        except (OSError, subprocess.CalledProcessError) as e:
            print(f"SKIPPED: {args.mavobserver}: {e}", file=sys.stderr)
        for solver in ("CLARABEL", "SCS"):
            if solver not in cp.installed_solvers():
                print(f"SKIPPED: {solver} is not installed", file=sys.stderr)
                continue
            begun = time.perf_counter()
            problem, gamma = build(args.alpha)
            try:
                problem.solve(solver=solver)
                value = 1000 * 0.1 * np.sqrt(max(gamma.value, 0))
            except (cp.error.SolverError, TypeError) as e:
                value, problem._status = float("nan"), str(e)[:30]
            rows.append((method, f"CVXPY + {solver}", value, time.perf_counter() - begun, problem.status))
    ours = {m: s for m, who, _, s, _ in rows if who == "mavobserver"}
    print(f"{'method':<8}{'by':<20}{'1000*sqrt(gamma)':>18}{'seconds':>10}{'ratio':>8}  outcome")
    for method, who, value, seconds, outcome in rows:
        ratio = seconds / ours[method] if method in ours else float("nan")
        print(f"{method:<8}{who:<20}{value:>18.3f}{seconds:>10.2f}{ratio:>8.1f}  {outcome}")


if __name__ == "__main__":
    main()
