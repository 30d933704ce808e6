#!/usr/bin/env python3
"""Print reference values for the tests of `orchestrator::statistics`, computed by other means.

    pip install scipy statsmodels && python3 benches/peers/statistics_reference.py

Tango's interval comes from a numerical maximisation of the multinomial likelihood instead of its closed form,
McNemar's mid-P from scipy's binomial distribution, Holm from statsmodels, and the confidence sequence from a grid of
hypothesised means instead of bisection.
"""

import math

import numpy as np
from scipy import optimize, special, stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

TABLES = [(1, 1, 7, 12), (36, 12, 2, 0), (43, 0, 1, 0), (10, 0, 0, 10), (150, 20, 8, 22), (0, 5, 0, 0)]


def tango(pairs, level=0.95):
    n11, n10, n01, n00 = pairs
    n = sum(pairs)

    def score(delta):
        """Return the score statistic with the nuisance probability p01 maximised numerically."""

        def loss(p01):
            p10 = p01 + delta
            rest = 1 - p01 - p10
            terms = ((n10, p10), (n01, p01), (n11 + n00, rest))
            return -sum(count * math.log(max(p, 1e-300)) for count, p in terms if count)

        low, high = max(0.0, -delta), (1 - delta) / 2
        found = optimize.minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-13})
        p01 = min((found.x, low, high), key=loss)
        return (n10 - n01 - n * delta) / math.sqrt(max(n * (2 * p01 + delta * (1 - delta)), 1e-300))

    z = stats.norm.ppf(0.5 + level / 2)
    d = (n10 - n01) / n
    edge = 1 - 1e-9
    low = optimize.brentq(lambda x: score(x) - z, -edge, d) if score(-edge) > z else -1.0
    high = optimize.brentq(lambda x: score(x) + z, d, edge) if d < edge and score(edge) < -z else 1.0
    return low, high


def newcombe(pairs):
    a, b, c, d = pairs
    n = sum(pairs)
    wilson = [proportion_confint(x, n, method="wilson") for x in (a + b, a + c)]
    p = [(a + b) / n, (a + c) / n]
    product = (a + b) * (c + d) * (a + c) * (b + d)
    numerator = a * d - b * c
    numerator = max(numerator - n / 2, 0) if numerator > 0 else numerator
    phi = numerator / math.sqrt(product) if product else 0
    l1, u1, l2, u2 = p[0] - wilson[0][0], wilson[0][1] - p[0], p[1] - wilson[1][0], wilson[1][1] - p[1]
    low = math.sqrt(max(l1**2 - 2 * phi * l1 * u2 + u2**2, 0))
    high = math.sqrt(max(u1**2 - 2 * phi * u1 * l2 + l2**2, 0))
    return p[0] - p[1] - low, p[0] - p[1] + high


def mid_p(pairs):
    _, b, c, _ = pairs
    if b + c == 0:
        return 1.0
    exact = min(1.0, 2 * stats.binom.cdf(min(b, c), b + c, 0.5))
    return (1.0 if b == c else exact) - (0.5 if b == c else 1.0) * stats.binom.pmf(b, b + c, 0.5)


def sequence(observations, alpha=0.05, grid=200_001):
    means = np.linspace(0, 1, grid)
    above, below = np.ones(grid), np.ones(grid)
    alive = np.ones(grid, bool)
    past = [0.5]
    for t, x in enumerate(observations, 1):
        running = [np.mean(past[: k + 1]) for k in range(len(past))]
        variance = (0.25 + sum((past[k] - running[k]) ** 2 for k in range(1, len(past)))) / t
        bet = math.sqrt(2 * math.log(2 / alpha) / (variance * t * math.log(t + 1)))
        with np.errstate(divide="ignore"):
            above *= 1 + np.minimum(bet, 0.5 / means) * (x - means)
            below *= 1 - np.minimum(bet, 0.5 / (1 - means)) * (x - means)
        alive &= np.maximum(above, below) < 2 / alpha
        past.append(x)
    kept = means[alive]
    return kept[0], kept[-1]


for pairs in TABLES:
    show = lambda interval: ", ".join(f"{x:.6f}" for x in interval)
    print(f"{pairs}: tango [{show(tango(pairs))}] newcombe [{show(newcombe(pairs))}] mid-p {mid_p(pairs):.6f}")
print("wilson 81/263:", proportion_confint(81, 263, method="wilson"))
p_values = [0.01, 0.04, 0.03, 0.005, 0.5]
print("holm:", multipletests(p_values, method="holm")[1])
for k, m in ((0, 0), (8, 8), (15, 20), (60, 100)):
    ln_e = m * math.log(2) + special.betaln(k + 0.5, m - k + 0.5) - special.betaln(0.5, 0.5)
    print(f"ln e({k}, {m}) = {ln_e:.9f}")
observations = [(1, 0.5, 0.5, 1, 0, 0.5, 1, 0.5)[i % 8] for i in range(120)]
print("confidence sequence:", sequence(observations))
