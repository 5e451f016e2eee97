"""The metrics' training in plain PyTorch: the paper's network and loss, as one would write them there."""

import math
import time
from typing import Any

import numpy as np
import torch


class Problem:
    """What a subtask is trained on: x, slope, velocity [N, 3], and the support's weight [N] there (None: one)."""

    def __init__(self, x: Any, slope: Any, velocity: Any, weight: Any):
        self.x, self.slope, self.velocity = (_tensor(a) for a in (x, slope, velocity))
        self.weight = None if weight is None else _tensor(weight)[:, None, None]


class CholeskyNetwork(torch.nn.Module):
    """From positions [N, 3] to lower triangular matrices [N, 3, 3]; `weights` as the JAX network keeps them."""

    def __init__(self, weights: dict[str, dict[str, Any]], activation: str, offset: float, length_scale: float):
        super().__init__()
        layers = [_linear(weights[f"Dense_{i}"]) for i in range(len(weights))]
        self.hidden = torch.nn.ModuleList(layers[:-2])
        self.diagonal, self.below = layers[-2:]
        self.activation = getattr(torch.nn.functional, activation)
        self.offset, self.length_scale = offset, length_scale
        self.rows, self.columns = torch.tril_indices(3, 3, -1)

    def forward(self, x):
        h = x / self.length_scale
        for layer in self.hidden:
            h = self.activation(layer(h))
        L = torch.diag_embed(self.diagonal(h).abs() + self.offset)
        L[:, self.rows, self.columns] = self.below(h)
        return L


def field_loss(network: CholeskyNetwork, problem: Problem) -> torch.Tensor:
    """Huber loss, delta 0.1, between `-M^-1 slope` and the velocity, summed over coordinates, mean over points."""
    L = network(problem.x)
    if problem.weight is not None:
        L = problem.weight * L + (1 - problem.weight) * torch.eye(3)
    field = -torch.cholesky_solve(problem.slope[:, :, None], L)[:, :, 0]
    loss = torch.nn.functional.huber_loss(field, problem.velocity, reduction="none", delta=0.1)
    return loss.sum(-1).mean()


def train(
    networks: list[CholeskyNetwork], problems: list[Problem], updates: int, learning_rate: float, weight_decay: float
) -> tuple[np.ndarray, float]:
    """Full-batch Adam with a learning rate that falls along a cosine, one subtask after the other.

    **Returns** the losses [updates, K], each before its update, and the seconds that it took.
    """
    losses = np.empty((updates, len(problems)))
    start = time.perf_counter()
    for k, (network, problem) in enumerate(zip(networks, problems, strict=True)):
        optimizer = torch.optim.Adam(network.parameters(), learning_rate, weight_decay=weight_decay)
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda i: 0.5 * (1 + math.cos(math.pi * i / updates)))
        for i in range(updates):
            optimizer.zero_grad()
            loss = field_loss(network, problem)
            loss.backward()
            optimizer.step()
            schedule.step()
            losses[i, k] = loss.item()
    return losses, time.perf_counter() - start


def _linear(weights: dict[str, Any]) -> torch.nn.Linear:
    kernel = _tensor(weights["kernel"])
    layer = torch.nn.Linear(*kernel.shape)
    with torch.no_grad():
        layer.weight.copy_(kernel.T)
        layer.bias.copy_(_tensor(weights["bias"]))
    return layer


def _tensor(array: Any) -> torch.Tensor:
    return torch.from_numpy(np.array(array, np.float32))
