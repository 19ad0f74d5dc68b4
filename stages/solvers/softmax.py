"""The paper's optimiser: a row-softmax selection matrix, driven by Adam.

    L = ‖ŜᵀF − F_kp‖ + α ‖(ŜᵀDŜ − D_kp) ∘ M‖ − β Σ_j (max_i Ŝ_ij − mean_i Ŝ_ij)

S is (n, k + 1), right-stochastic; the last column stands for "no keypoint"; Ŝ is its first k columns. Two things make
it several times as fast as automatic differentiation of that line: the gradient shares D Ŝ with the value (D is
symmetric), so one large product a step does instead of three; and Sᵀ is what is stored, since the product is faster
with the candidates along rows.
"""

from __future__ import annotations

import numpy as np
import torch

from b23d.stages.solvers.objective import Problem


class SelectionLoss:
    """Value and gradient of the relaxed objective at unnormalised Sᵀ, (k + 1, n)."""

    def __init__(self, problem: Problem, beta: float) -> None:
        self.features = _tensor(problem.features)
        self.distances = _tensor(problem.distances)
        self.wanted = _tensor(problem.target_features)
        self.mask = _tensor(problem.mask)
        self.between = _tensor(np.where(problem.mask, problem.target_distances, 0))  # NaN × 0 would stay NaN
        self.alpha, self.beta = problem.alpha, beta

    def __call__(self, logits: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """logits (k + 1, n) → loss (), gradient (k + 1, n)."""
        stochastic = torch.softmax(logits, dim=0)
        selection = stochastic[:-1]  # Ŝᵀ (k, n)

        feature = selection @ self.features - self.wanted
        feature_norm = feature.square().sum().sqrt()
        spread = selection @ self.distances  # (D Ŝ)ᵀ
        distance = (spread @ selection.T - self.between) * self.mask  # (k, k)
        distance_norm = distance.square().sum().sqrt()
        loss = feature_norm + self.alpha * distance_norm

        tiny = torch.finfo(feature_norm.dtype).tiny  # a norm has no gradient at zero; zero is a subgradient
        feature /= feature_norm.clamp_min(tiny)
        distance *= self.alpha / distance_norm.clamp_min(tiny)
        gradient = feature @ self.features.T
        gradient += (distance + distance.T) @ spread
        if self.beta:
            n = selection.shape[1]
            largest, where = selection.max(1)
            loss = loss - self.beta * (largest.sum() - selection.sum() / n)
            gradient += self.beta / n
            gradient.scatter_add_(1, where[:, None], torch.full((len(where), 1), -self.beta))
        # through the softmax; the last column, "no keypoint", has no gradient of its own
        mean = (gradient * selection).sum(0, keepdim=True)
        return loss, torch.cat([selection * (gradient - mean), -stochastic[-1:] * mean])


def softmax(
    problem: Problem,
    *,
    beta: float = 0.0,
    steps: int = 5000,
    learning_rate: float = 0.1,
    seed: int = 0,
    one_to_one: bool = False,
) -> np.ndarray:
    """Choice (k,) int64: the largest entry of every column of Ŝ after `steps` of Adam from a seeded N(0, 1).

    one_to_one: instead the assignment with the largest Σ_j Ŝ[c_j, j] in which no candidate occurs twice.
    """
    loss = SelectionLoss(problem, beta)
    logits = torch.randn(problem.k + 1, problem.n, generator=torch.Generator().manual_seed(seed))
    optimiser = torch.optim.Adam([logits], lr=learning_rate, fused=True)
    with torch.no_grad():
        for _ in range(steps):
            logits.grad = loss(logits)[1]
            optimiser.step()
        return _choose(torch.softmax(logits, dim=0)[:-1].numpy(), one_to_one)


def _tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


def _choose(selection: np.ndarray, one_to_one: bool) -> np.ndarray:
    """(k,) int64 from Ŝᵀ (k, n)."""
    if one_to_one:
        from scipy.optimize import linear_sum_assignment

        choice: np.ndarray = linear_sum_assignment(selection, maximize=True)[1]
        return choice
    return selection.argmax(1)
