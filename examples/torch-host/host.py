"""Serves a small convolutional policy written in PyTorch."""

import argparse

import hypogeum
import torch
from torch import nn

N_ROWS = 30
STATE_DIM, ACTION_DIM = 25, 7


class ConvPolicy(nn.Module):
    """Maps one image and the state to a chunk of actions in [-1, 1]."""

    def __init__(self):
        super().__init__()
        self.vision = nn.Sequential(
            nn.Conv2d(3, 16, 5, stride=4), nn.ReLU(),
            nn.Conv2d(16, 32, 3, stride=2), nn.ReLU(),
            nn.AdaptiveAvgPool2d(4), nn.Flatten(),
        )
        self.head = nn.Sequential(
            nn.Linear(32 * 16 + STATE_DIM, 256), nn.ReLU(), nn.Linear(256, N_ROWS * ACTION_DIM), nn.Tanh()
        )

    def forward(self, image, state):
        """`image` [n, 3, height, width] f32 in [0, 1], `state` [n, 25] f32 -> [n, 30, 7] f32."""
        features = torch.cat([self.vision(image), state], dim=1)
        return self.head(features).view(-1, N_ROWS, ACTION_DIM)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--name", default="net", help="lane to attach to: hypogeum run --policy NAME=attach:NAME")
    parser.add_argument("--weights", help="state_dict to load; random weights otherwise")
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()

    torch.manual_seed(0)
    torch.set_num_threads(1)
    network = ConvPolicy().to(args.device).eval()
    if args.weights:
        network.load_state_dict(torch.load(args.weights, map_location=args.device, weights_only=True))

    @torch.inference_mode()
    def policy(observation):
        tensors = observation.torch()
        chunks = []
        for image, state in zip(tensors["external1_camera"], tensors["state"]):
            image = image.to(args.device).permute(2, 0, 1)[None].float() / 255
            chunks.append(network(image, state.to(args.device)[None])[0].cpu())
        return torch.stack(chunks)

    print(hypogeum.serve(policy, args.name))


if __name__ == "__main__":
    main()
