"""Pseudo-random arrays computed from a name, bitwise equal to those that the Rust policies compute."""

import math

import numpy as np

MASK = (1 << 64) - 1


def fnv1a64(name):
    """Return the 64-bit FNV-1a hash of a string's UTF-8 bytes."""
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = ((value ^ byte) * 0x100000001B3) & MASK
    return value


def unit(name, shape):
    """Return an f32 array of values in [0, 1).

    Element `i` is the top 24 bits of splitmix64's finaliser applied to `fnv1a64(name) + i * gamma`.
    """
    with np.errstate(over="ignore"):
        z = np.uint64(fnv1a64(name)) + np.arange(math.prod(shape), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z ^= z >> np.uint64(30)
        z *= np.uint64(0xBF58476D1CE4E5B9)
        z ^= z >> np.uint64(27)
        z *= np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return ((z >> np.uint64(40)).astype(np.float32) / np.float32(1 << 24)).reshape(shape)


def sym(name, shape, bound):
    """Return an f32 array of values in [-bound, bound)."""
    return (2 * unit(name, shape) - 1) * np.float32(bound)
