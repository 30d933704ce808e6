"""Conversion of images to network inputs."""

import warnings


def resize(pixels, height, width):
    """Resize images by antialiased bilinear interpolation in f32, rounded to integers.

    As for the benchmark's training images, halves round up, and so do values that floating-point error leaves just
    below a half.

    Args:
        pixels: Tensor `[n, height, width, 3] u8`.
        height: Output height in pixels.
        width: Output width in pixels.

    Returns:
        `[n, 3, height, width] f32`, integers from 0 to 255.
    """
    import torch
    import torch.nn.functional as F

    pixels = pixels.permute(0, 3, 1, 2).to(torch.float32)
    pixels = F.interpolate(pixels, (height, width), mode="bilinear", antialias=True, align_corners=False)
    return (pixels + 0.501).floor().clamp(0, 255)


def to_network(images, height=None, width=None, device="cpu"):
    """Convert images to a torch tensor in [0, 1], resizing them if necessary.

    Pixels are read where they are: on a CPU they are not copied before they become f32, and to another device they
    travel as bytes.

    Args:
        images: Array or tensor on the CPU, `[n, height, width, 3] u8`.
        height: Output height in pixels; that of the images by default.
        width: Output width in pixels; that of the images by default.
        device: Torch device of the output.

    Returns:
        `[n, 3, height, width] f32`.
    """
    import torch

    device = torch.device(device)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
        pixels = torch.as_tensor(images)
    if tuple(pixels.shape[1:3]) != (height or pixels.shape[1], width or pixels.shape[2]):
        pixels = resize(pixels, height or pixels.shape[1], width or pixels.shape[2]).to(device)
    else:
        if device.type != "cpu":
            # The images of a batch are apart in memory, but each of them is contiguous.
            pixels = torch.stack([image.to(device) for image in pixels])
        pixels = pixels.permute(0, 3, 1, 2).to(torch.float32, memory_format=torch.contiguous_format)
    # A tensor as divisor, because CUDA multiplies by the reciprocal of a number.
    return pixels.div_(torch.tensor(255.0, device=device))
