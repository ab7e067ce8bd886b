"""Mixture of Student's t distributions and the prior: importance sampling's adaptive proposal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.prior import JointPrior

#: Degrees of freedom of the t components: heavier tails than a posterior's cost little, and reach
#: what lies off its main body.
DOF = 2.5
#: Least share of the prior: with it no weight can exceed the greatest likelihood over this.
DEFENCE = 0.05


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """`share` (k,) of the t components with `mean` (k, p) and scale matrix `scale` (k, p, p); the
    rest, to 1, is the prior's.

    Means and scales are in the coordinates of `JointPrior.coordinates`; draws and densities in the
    parameters themselves.
    """

    prior: JointPrior
    share: FloatArray
    mean: FloatArray
    scale: FloatArray

    @property
    def defence(self) -> float:
        """The prior's share."""
        return 1.0 - float(self.share.sum())

    @cached_property
    def _root(self) -> FloatArray:
        return np.asarray(np.linalg.cholesky(self.scale), dtype=np.float64)

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Independent draws, (n, p)."""
        k, p = self.mean.shape
        which = rng.choice(k + 1, size=n, p=np.r_[self.share, self.defence])
        stretch = np.sqrt(DOF / rng.chisquare(DOF, n))
        normal = rng.standard_normal((n, p)) * stretch[:, None]
        theta = self.prior.draw(rng, n)
        for i in range(k):
            from_it = which == i
            theta[from_it] = self.prior.parameters(self.mean[i] + normal[from_it] @ self._root[i].T)
        return theta

    def _parts(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log density in coordinates of each t component, share included, (k, n), and squared
        Mahalanobis distances from its mean.
        """
        p = at.shape[1]
        constant = (
            math.lgamma((DOF + p) / 2) - math.lgamma(DOF / 2) - 0.5 * p * math.log(DOF * math.pi)
        )
        away = np.linalg.solve(self._root, np.swapaxes(at[None] - self.mean[:, None], 1, 2))
        square = np.einsum("kpn,kpn->kn", away, away)
        log_det = np.log(np.diagonal(self._root, axis1=1, axis2=2)).sum(axis=1)
        log = (
            constant
            - log_det[:, None]
            - 0.5 * (DOF + p) * np.log1p(square / DOF)
            + np.log(self.share)[:, None]
        )
        return log, square

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Log density of the whole mixture, (n,)."""
        parts = self._parts(self.prior.coordinates(theta))[0] + self.prior.log_stretch(theta)
        log = np.vstack([parts, self.prior.log_density(theta) + math.log(self.defence)])
        top = log.max(axis=0)
        result: FloatArray = top + np.log(np.exp(log - top).sum(axis=0))
        return result

    def learn(self, theta: FloatArray, weight: FloatArray) -> Mixture:
        """One expectation-maximisation step towards the weighted draws (n, p), (n,)."""
        p = theta.shape[1]
        weight = weight / weight.sum()
        at = self.prior.coordinates(theta)
        log, square = self._parts(at)
        duty = weight * np.exp(log + self.prior.log_stretch(theta) - self.log_density(theta))
        near = duty * (DOF + p) / (DOF + square)
        share = np.minimum(duty.sum(axis=1), 1.0)
        # a component supported by a handful of draws would collapse onto them
        alive = share**2 > 5 * p * np.einsum("kn,kn->k", duty, duty)
        if not alive.any():
            return self
        mean = (near[alive] @ at) / near[alive].sum(axis=1)[:, None]
        away = at[None] - mean[:, None]
        scale = np.einsum("kn,knp,knq->kpq", near[alive], away, away) / share[alive][:, None, None]
        jitter = 1e-10 * np.maximum(np.diagonal(scale, axis1=1, axis2=2), 1e-300)
        return replace(
            self,
            share=_leave(share[alive]),
            mean=mean,
            scale=scale + jitter[:, :, None] * np.eye(p),
        )

    def split(
        self, rng: np.random.Generator, theta: FloatArray, weight: FloatArray, k: int
    ) -> Mixture:
        """A mixture of `k` components at draws picked by weight, each with 1 / k of the whole's
        volume: a start for shapes that one component cannot follow.
        """
        p = theta.shape[1]
        at = self.prior.coordinates(theta[weight > 0])
        weight = weight[weight > 0]
        picked = at[rng.choice(len(at), size=k, p=weight / weight.sum())]
        whole = np.atleast_2d(np.cov(at.T, aweights=weight)) / k ** (2 / p)
        whole += 1e-10 * np.diag(np.maximum(np.diag(whole), 1e-300))
        return replace(
            self,
            share=_leave(np.full(k, 0.9 / k)),
            mean=picked,
            scale=np.broadcast_to(whole, (k, p, p)),
        )


def _leave(share: FloatArray) -> FloatArray:
    """Shares scaled to leave the prior at least `DEFENCE`."""
    return share * min(1.0, (1 - DEFENCE) / float(share.sum()))
