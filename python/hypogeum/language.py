"""Language encoder without weights: hashes the words and word pairs of an instruction into a vector.

The vectors are bitwise equal to those of the Rust policies. A checkpoint must be used with the encoder it was trained
with, which its configuration names.
"""

import math
import re

import numpy as np

from .generated import sym


def hashed_embedding(instruction, dim):
    """Return the embedding of an instruction, `[dim] f32` with an expected norm of 1, or zeros if it has no words."""
    words = re.findall(r"[a-z0-9]+", instruction.lower())
    features = words + [" ".join(pair) for pair in zip(words, words[1:])]
    bound = math.sqrt(3 / (dim * max(len(features), 1)))
    return sum((sym(feature, (dim,), bound) for feature in features), np.zeros(dim, np.float32))
