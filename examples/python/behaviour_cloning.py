"""Behaviour cloning: trains a small network on demonstrations of RaiseCube, and evaluates it in a vector env."""

import argparse

import hypogeum
import torch
from torch import nn
from torch.nn.functional import avg_pool2d, smooth_l1_loss

TASK, N_ROWS, STATE_DIM, ACTION_DIM = "RaiseCube", 10, 25, 7
# The cameras that the network sees, and the factors by which their images are downscaled.
FACTORS = {"external1_camera": 4, "hand_camera": 2}


def inputs(observation):
    """Return the network's inputs: the images, [n, 3, height, width] u8 each, and the states, [n, 25] f32."""
    images = [torch.from_numpy(observation[name]).permute(0, 3, 1, 2).float() for name in FACTORS]
    small = [avg_pool2d(it, factor).byte() for it, factor in zip(images, FACTORS.values())]
    return [*small, torch.from_numpy(observation["state"])]


def examples(path):
    """Return the inputs of all frames, and the action rows that follow each, [n, N_ROWS, 7] f32."""
    found = []
    for demonstration in hypogeum.Demonstrations(path, TASK, images=list(FACTORS)):
        n = len(demonstration)
        following = torch.arange(n)[:, None] + torch.arange(N_ROWS)
        chunks = torch.from_numpy(demonstration.actions)[following.clamp(max=n - 1)]
        found.append([*inputs(demonstration.observations), chunks])
    *frames, chunks = map(torch.cat, zip(*found))
    return frames, chunks


class SpatialSoftmax(nn.Module):
    """Maps every channel to the place where it is strongest: [n, channels, height, width] -> [n, 2 channels]."""

    def forward(self, x):
        weights = x.flatten(2).softmax(2).view_as(x)
        rows, columns = (torch.linspace(-1, 1, side) for side in x.shape[2:])
        return torch.cat([weights.sum(3) @ rows, weights.sum(2) @ columns], dim=1)


class Network(nn.Module):
    """Maps images and states to a chunk of actions, [n, N_ROWS, 7]. It normalises states and actions by examples."""

    def __init__(self, states, chunks):
        super().__init__()
        for name, values in {"states": states, "actions": chunks.flatten(0, 1)}.items():
            self.register_buffer(f"mean_{name}", values.mean(0))
            self.register_buffer(f"std_{name}", values.std(0) + 1e-3)
        self.vision = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(3, 16, 5, stride=2), nn.ReLU(), nn.Conv2d(16, 32, 3, stride=2), nn.ReLU(),
                nn.Conv2d(32, 32, 3), SpatialSoftmax(),
            )
            for _ in FACTORS
        )  # fmt: skip
        self.head = nn.Sequential(
            nn.Linear(64 * len(FACTORS) + STATE_DIM, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(),
            nn.Linear(256, N_ROWS * ACTION_DIM),
        )  # fmt: skip

    def forward(self, *images, states):
        features = [vision(it.float() / 255 - 0.5) for vision, it in zip(self.vision, images)]
        hidden = torch.cat([*features, (states - self.mean_states) / self.std_states], dim=1)
        return self.head(hidden).view(-1, N_ROWS, ACTION_DIM) * self.std_actions + self.mean_actions


def train(network, frames, chunks, n_steps):
    optimiser = torch.optim.Adam(network.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 1e-3, total_steps=n_steps)
    for step in range(n_steps):
        batch = torch.randint(len(chunks), (64,))
        *images, states = (it[batch] for it in frames)
        error = (network(*images, states=states) - chunks[batch]) / network.std_actions
        loss = smooth_l1_loss(error, torch.zeros_like(error))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if (step + 1) % 500 == 0:
            print(f"step {step + 1}: loss {loss:.4f}", flush=True)


@torch.inference_mode()
def evaluate(network, n_episodes):
    """Return in how many of the first episodes of suite seed 0 the network succeeds."""
    env = hypogeum.make_vec(TASK, n_episodes, images=list(FACTORS))
    observation, _ = env.reset()
    is_over = False
    while not is_over:
        *images, states = inputs(observation)
        # All episodes last for the task's horizon, and end together.
        observation, _, _, truncated, info = env.step_chunk(network(*images, states=states).numpy())
        is_over = truncated.all()
    return int(info["is_success"].sum())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", help="dataset of `hypogeum demos` or `hypogeum.record`, such as demos/single")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    frames, chunks = examples(args.dataset)
    print(f"{len(chunks)} frames", flush=True)
    network = Network(frames[-1], chunks)
    train(network, frames, chunks, args.steps)
    print(f"{evaluate(network, args.episodes)} of {args.episodes} episodes succeed")
