"""Pseudo-random arrays computed from a name, bitwise equal to those that the Rust policies compute."""

import math

import numpy as np

MASK = (1 << 64) - 1
# Increment of splitmix64.
GAMMA = 0x9E3779B97F4A7C15
# Name of the random stream from which a policy's noise is drawn.
NOISE = "pi05.noise"


def fnv1a64(name):
    """Return the 64-bit FNV-1a hash of a string's UTF-8 bytes."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = ((value ^ byte) * 0x100000001B3) & MASK
    return value


def splitmix64(values):
    """Apply splitmix64's finaliser to an array of u64."""
    with np.errstate(over="ignore"):
        z = values ^ values >> np.uint64(30)
        z *= np.uint64(0xBF58476D1CE4E5B9)
        z ^= z >> np.uint64(27)
        z *= np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return z


def unit(name, shape):
    """Return an f32 array of values in [0, 1): the start of the stream that begins at `fnv1a64(name)`."""
    return stream(fnv1a64(name), math.prod(shape)).reshape(shape)


def stream(start, n):
    """Return `n` f32 values in [0, 1).

    Element `i` is the top 24 bits of splitmix64's finaliser applied to `start + i * gamma`.
    """
    with np.errstate(over="ignore"):
        z = splitmix64(np.uint64(start) + np.arange(n, dtype=np.uint64) * np.uint64(GAMMA))
    return (z >> np.uint64(40)).astype(np.float32) / np.float32(1 << 24)


def sym(name, shape, bound):
    """Return an f32 array of values in [-bound, bound)."""
    return (2 * unit(name, shape) - 1) * np.float32(bound)


def draw_noise(policy_seed, query, shape):
    """Draw the noise of one query from the normal distribution, as the built-in π0.5 does.

    Returns:
        An f32 array that is a function of the episode's seed and the query alone.
    """
    mix = lambda z: int(splitmix64(np.array([z & MASK], np.uint64))[0])  # noqa: E731
    episode = mix(policy_seed ^ fnv1a64(NOISE))
    n_pairs = (math.prod(shape) + 1) // 2
    uniform = stream(mix(episode + query * GAMMA), 2 * n_pairs).astype(np.float64).reshape(n_pairs, 2)
    # Box and Muller's transform; `1 - uniform` lies in (0, 1].
    radius, angle = np.sqrt(-2 * np.log(1 - uniform[:, 0])), 2 * np.pi * uniform[:, 1]
    pairs = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return pairs.astype(np.float32).reshape(-1)[: math.prod(shape)].reshape(shape)
