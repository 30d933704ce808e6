"""Conversion of images to network inputs."""

import warnings

import numpy as np


def to_network(images, height, width):
    """Convert images to a torch tensor in [0, 1], resizing them if necessary.

    Resizing uses antialiased bilinear interpolation in f32 and rounds to integers, as for the benchmark's training
    images. Halves round up, and so do values that floating-point error leaves just below a half.

    Args:
        images: `[n, side, side, 3] u8`.
        height: Output height in pixels.
        width: Output width in pixels.

    Returns:
        `[n, 3, height, width] f32`.
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
