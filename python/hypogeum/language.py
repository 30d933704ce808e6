"""A language encoder without weights: an instruction becomes a vector by hashing its words and word pairs.

The same vector as that of the built-in policies, number by number. A checkpoint must be used with the encoder it was
trained with; its configuration says which.
"""

import math
import re

import numpy as np

from .generated import sym


def hashed_embedding(instruction, dim):
    """`[dim] f32` of expected length 1; an instruction without a word is the zero vector."""
    words = re.findall(r"[a-z0-9]+", instruction.lower())
    features = words + [" ".join(pair) for pair in zip(words, words[1:])]
    bound = math.sqrt(3 / (dim * max(len(features), 1)))
    return sum((sym(feature, (dim,), bound) for feature in features), np.zeros(dim, np.float32))
