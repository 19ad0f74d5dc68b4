"""The paper's optimiser: a row-softmax selection matrix, driven by Adam.

    L = ‖ŜᵀF − F_kp‖ + α ‖(ŜᵀDŜ − D_kp) ∘ M‖ − β Σ_j (max_i Ŝ_ij − mean_i Ŝ_ij)

S is (n, k + 1), right-stochastic; the last column stands for "no keypoint"; Ŝ is its first k columns. Three things make
it several times as fast as automatic differentiation of that line: the gradient shares D Ŝ with the value (D is
symmetric), so one large product a step does instead of three; Sᵀ is what is stored, since the product is faster with
the candidates along rows; and problems on one target (several draws of shots) can share that product, whose cost is
reading D.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from b23d.stages.solvers.objective import Problem


class SelectionLoss:
    """Values and gradients of the relaxed objectives of b problems on one target, at unnormalised Sᵀ, (b, k + 1, n).

    k is the largest number of keypoints; a problem with fewer has −inf in the rows it lacks, before the last, which
    select nothing.
    """

    def __init__(self, problems: Sequence[Problem], beta: float) -> None:
        first, k = problems[0], max(problem.k for problem in problems)
        self.features = torch.from_numpy(np.ascontiguousarray(first.features, dtype=np.float32))
        self.distances = torch.from_numpy(np.ascontiguousarray(first.distances, dtype=np.float32))
        self.wanted = torch.zeros(len(problems), k, self.features.shape[1])
        self.mask, self.between = torch.zeros(len(problems), k, k), torch.zeros(len(problems), k, k)
        self.has = torch.zeros(len(problems), k, dtype=torch.bool)
        for i, problem in enumerate(problems):
            self.wanted[i, : problem.k] = torch.from_numpy(problem.target_features.astype(np.float32))
            self.mask[i, : problem.k, : problem.k] = torch.from_numpy(problem.mask.astype(np.float32))
            known = np.where(problem.mask, problem.target_distances, 0)  # NaN × 0 would stay NaN
            self.between[i, : problem.k, : problem.k] = torch.from_numpy(known.astype(np.float32))
            self.has[i, : problem.k] = True
        self.alpha, self.beta = first.alpha, beta

    def __call__(self, logits: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """logits (b, k + 1, n) → losses (b,), gradients (b, k + 1, n)."""
        stochastic = torch.softmax(logits, dim=1)
        selection = stochastic[:, :-1]  # Ŝᵀ (b, k, n)
        b, k, n = selection.shape
        rows = selection.reshape(b * k, n)

        feature = (rows @ self.features).view(b, k, -1) - self.wanted
        feature_norm = feature.square().sum((1, 2)).sqrt()
        spread = (rows @ self.distances).view(b, k, n)  # (D Ŝ)ᵀ
        distance = (spread @ selection.mT - self.between) * self.mask  # (b, k, k)
        distance_norm = distance.square().sum((1, 2)).sqrt()
        loss = feature_norm + self.alpha * distance_norm

        tiny = torch.finfo(feature_norm.dtype).tiny  # a norm has no gradient at zero; zero is a subgradient
        feature /= feature_norm.clamp_min(tiny)[:, None, None]
        distance *= self.alpha / distance_norm.clamp_min(tiny)[:, None, None]
        gradient = (feature.view(b * k, -1) @ self.features.T).view(b, k, n)
        gradient += (distance + distance.mT) @ spread
        if self.beta:
            largest, where = selection.max(2)
            loss = loss - self.beta * (largest.sum(1) - selection.sum((1, 2)) / n)
            gradient += self.beta / n
            gradient.scatter_add_(2, where[..., None], -self.beta * self.has[..., None].float())
        # through the softmax; the last column, "no keypoint", has no gradient of its own
        mean = (gradient * selection).sum(1, keepdim=True)
        return loss, torch.cat([selection * (gradient - mean), -stochastic[:, -1:] * mean], dim=1)


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
    return softmax_together(
        [problem], beta=beta, steps=steps, learning_rate=learning_rate, seed=seed, one_to_one=one_to_one
    )[0]


def softmax_together(
    problems: Sequence[Problem],
    *,
    beta: float = 0.0,
    steps: int = 5000,
    learning_rate: float = 0.1,
    seed: int = 0,
    one_to_one: bool = False,
) -> list[np.ndarray]:
    """`softmax` of several problems on one target at once, each as if alone (but for rounding), in their order.

    Raises ValueError where they are not of one target and one α.
    """
    first = problems[0]
    if any(p.features.shape != first.features.shape or p.alpha != first.alpha for p in problems):
        got = [(p.n, p.features.shape[1], p.alpha) for p in problems]
        raise ValueError(f"problems: expected those of one target and one alpha, got {got}; solve them one by one")
    loss = SelectionLoss(problems, beta)
    logits = torch.full((len(problems), max(p.k for p in problems) + 1, first.n), -torch.inf)
    for i, problem in enumerate(problems):
        start = torch.randn(problem.k + 1, problem.n, generator=torch.Generator().manual_seed(seed))
        logits[i, : problem.k], logits[i, -1] = start[:-1], start[-1]
    optimiser = torch.optim.Adam([logits], lr=learning_rate, fused=True)
    with torch.no_grad():
        for _ in range(steps):
            logits.grad = loss(logits)[1]
            optimiser.step()
        selections = torch.softmax(logits, dim=1)[:, :-1].numpy()  # Ŝᵀ (b, k, n)
    return [
        _choose(selection[: problem.k], one_to_one) for selection, problem in zip(selections, problems, strict=True)
    ]


def _choose(selection: np.ndarray, one_to_one: bool) -> np.ndarray:
    """(k,) int64 from Ŝᵀ (k, n)."""
    if one_to_one:
        from scipy.optimize import linear_sum_assignment

        choice: np.ndarray = linear_sum_assignment(selection, maximize=True)[1]
        return choice
    return selection.argmax(1)
