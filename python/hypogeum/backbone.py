"""ResNet-18 backbones of any width for LeRobot's ACT, which supports only torchvision's width."""

import contextlib
import json
from pathlib import Path

import torchvision
from torch import nn
from torchvision.models.resnet import BasicBlock, ResNet

from .weights import plain_name

# Number of channels in the first stage of torchvision's ResNet-18.
FULL_WIDTH = 64
STEM = "model.backbone.conv1.weight"


def resnet18(width, norm_layer=nn.BatchNorm2d):
    """Return a randomly initialised ResNet-18 whose stages have 1, 2, 4 and 8 times `width` channels."""
    network = ResNet(BasicBlock, [2, 2, 2, 2], norm_layer=norm_layer)
    network.inplanes = width
    network.conv1 = nn.Conv2d(3, width, 7, stride=2, padding=3, bias=False)
    network.bn1 = norm_layer(width)
    for stage in range(4):
        layer = network._make_layer(BasicBlock, width << stage, 2, stride=1 if stage == 0 else 2)
        setattr(network, f"layer{stage + 1}", layer)
    network.fc = nn.Linear(8 * width, 1)
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
    return network


@contextlib.contextmanager
def resnet18_of(width):
    """Replace `torchvision.models.resnet18` by a ResNet-18 of this width within the context."""

    def make(weights=None, norm_layer=nn.BatchNorm2d, replace_stride_with_dilation=()):
        if weights is not None:
            raise ValueError(f"there are no pretrained weights for a ResNet-18 of width {width}")
        if any(replace_stride_with_dilation):
            raise ValueError("replace_final_stride_with_dilation is true, but a ResNet-18 has no dilated convolutions")
        return resnet18(width, norm_layer)

    original = torchvision.models.resnet18
    if width != FULL_WIDTH:
        torchvision.models.resnet18 = make
    try:
        yield
    finally:
        torchvision.models.resnet18 = original


def width_of(folder):
    """Return the width of the ResNet in a checkpoint's `model.safetensors`, or `FULL_WIDTH` if it has none."""
    with open(Path(folder) / "model.safetensors", "rb") as file:
        header = json.loads(file.read(int.from_bytes(file.read(8), "little")))
    stem = next((name for name in header if plain_name(name) == STEM), None)
    return header[stem]["shape"][0] if stem else FULL_WIDTH
