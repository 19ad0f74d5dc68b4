"""The paper's optimiser: a row-softmax selection matrix, driven by Adam.

    L = ‖ŜᵀF − F_kp‖ + α ‖(ŜᵀDŜ − D_kp) ∘ M‖ − β Σ_j (max_i Ŝ_ij − mean_i Ŝ_ij)

S is (n, k + 1), right-stochastic; the last column stands for "no keypoint"; Ŝ is its first k columns. Two things make it several
times as fast as automatic differentiation of that line: the gradient shares D Ŝ with the value (D is symmetric), so one large
product a step does instead of three; and Sᵀ is what is stored, since the product is faster with the candidates along rows.
"""

from __future__ import annotations

import numpy as np
import torch

from stages.solvers.objective import Problem


class SelectionLoss:
    """Value and gradient of the relaxed objective at unnormalised Sᵀ, (k + 1, n)."""

    def __init__(self, problem: Problem, beta: float) -> None:
        self.features = torch.from_numpy(np.ascontiguousarray(problem.features, dtype=np.float32))
        self.distances = torch.from_numpy(np.ascontiguousarray(problem.distances, dtype=np.float32))
        self.wanted = torch.from_numpy(problem.target_features.astype(np.float32))
        self.mask = torch.from_numpy(problem.mask.astype(np.float32))
        known = np.where(problem.mask, problem.target_distances, 0)  # NaN × 0 would stay NaN
        self.between = torch.from_numpy(known.astype(np.float32))
        self.alpha, self.beta = problem.alpha, beta

    def __call__(self, logits: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """logits (k + 1, n) → loss (), gradient (k + 1, n)."""
        stochastic = torch.softmax(logits, dim=0)
        selection = stochastic[:-1]  # Ŝᵀ (k, n)
        k, n = selection.shape

        feature = selection @ self.features - self.wanted  # (k, channel)
        feature_norm = feature.norm()
        spread = selection @ self.distances  # (D Ŝ)ᵀ (k, n)
        distance = (spread @ selection.T - self.between) * self.mask  # (k, k)
        distance_norm = distance.norm()
        loss = feature_norm + self.alpha * distance_norm

        tiny = torch.finfo(feature_norm.dtype).tiny  # a norm has no gradient at zero; zero is a subgradient
        gradient = feature @ self.features.T / feature_norm.clamp_min(tiny)
        gradient += self.alpha * ((distance + distance.T) @ spread) / distance_norm.clamp_min(tiny)
        if self.beta:
            largest, where = selection.max(1)
            loss = loss - self.beta * (largest.sum() - selection.sum() / n)
            gradient += self.beta / n
            gradient[torch.arange(k), where] -= self.beta
        # through the softmax; the last column, "no keypoint", has no gradient of its own
        mean = (gradient * selection).sum(0, keepdim=True)
        return loss, torch.cat([selection * (gradient - mean), -stochastic[-1:] * mean])


def softmax(
    problem: Problem, *, beta: float = 0.0, steps: int = 5000, learning_rate: float = 0.1, seed: int = 0, one_to_one: bool = False
) -> np.ndarray:
    """Choice (k,) int64: the largest entry of every column of Ŝ after `steps` of Adam from a seeded N(0, 1).

    one_to_one: instead the assignment with the largest Σ_j Ŝ[c_j, j] in which no candidate occurs twice.
    """
    random = torch.Generator().manual_seed(seed)
    logits = torch.randn(problem.k + 1, problem.n, generator=random)
    loss = SelectionLoss(problem, beta)
    optimiser = torch.optim.Adam([logits], lr=learning_rate)
    with torch.no_grad():
        for _ in range(steps):
            logits.grad = loss(logits)[1]
            optimiser.step()
        selection = torch.softmax(logits, dim=0)[:-1].numpy()  # Ŝᵀ (k, n)
    if one_to_one:
        from scipy.optimize import linear_sum_assignment

        return linear_sum_assignment(selection, maximize=True)[1]
    return selection.argmax(1)
