"""Images as a network wants them."""

import warnings

import numpy as np


def to_network(images, height, width):
    """`[n, side, side, 3] u8` to `[n, 3, height, width] f32` in [0, 1], a torch tensor.

    Another size is made by antialiased bilinear interpolation in f32 and rounded to the integers that an image has: what
    the benchmark's resized training images hold. Halves go up, and what rounding errors leave just below a half, too.
    """
    import torch
    import torch.nn.functional as F

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
        pixels = torch.from_numpy(np.asarray(images))
    pixels = pixels.permute(0, 3, 1, 2).to(torch.float32)
    if pixels.shape[2:] != (height, width):
        pixels = F.interpolate(pixels, (height, width), mode="bilinear", antialias=True, align_corners=False)
        pixels = (pixels + 0.501).floor().clamp(0, 255)
    return (pixels / 255).contiguous()
