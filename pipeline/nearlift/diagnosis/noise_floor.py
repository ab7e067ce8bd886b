"""The scatter of trials about anything smooth: variance components orthogonal to every family and every library effect.

Taken from raw scatter within cells, a drift or a sagging supply would be booked as noise and then hide behind it. So the
components are estimated by restricted maximum likelihood in what is left after all flexible columns together, by Fisher
scoring, with outlying trials pulled in to 3.5 standard deviations. Noise that neighbours within a visit have in common is added
where it shows itself beyond doubt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fitting.covariance import serial_block, visits_by_size
from nearlift.fitting.noise import ENOUGH, trial_covariance
from nearlift.results import IntArray, Noise, Observations

CLIP = 3.5
#: Noise shared by neighbours is looked for over these numbers of trials, and believed beyond so many standard errors.
SERIAL_LENGTHS = (1.0, 3.0, 10.0, 30.0)
BEYOND_DOUBT = 3.5


@dataclass(frozen=True, kw_only=True)
class _Components:
    """Variance components as blocks by visit: `own` fixed, each of `parts` a list of (m, b, b) matching `index`."""

    index: list[IntArray]
    own: FloatArray
    parts: list[list[FloatArray]]

    def projector(self, basis: FloatArray, sizes: FloatArray) -> FloatArray:
        """P = V^-1 - V^-1 X (X' V^-1 X)^-1 X' V^-1, dense (n, n)."""
        n = len(self.own)
        p = np.zeros((n, n))
        for i, index in enumerate(self.index):
            block = self.own[index][:, :, None] * np.eye(index.shape[1]) + sum(s * part[i] for s, part in zip(sizes, self.parts, strict=True))
            p[index[:, :, None], index[:, None, :]] = np.linalg.inv(block)
        vx = p @ basis
        result: FloatArray = p - vx @ np.linalg.solve(basis.T @ vx, vx.T)
        return result

    def deviance(self, basis: FloatArray, y: FloatArray, sizes: FloatArray) -> float:
        """Minus twice the restricted log likelihood, up to a constant."""
        total, vy, vx = 0.0, np.empty_like(y), np.empty_like(basis)
        for i, index in enumerate(self.index):
            block = self.own[index][:, :, None] * np.eye(index.shape[1]) + sum(s * part[i] for s, part in zip(sizes, self.parts, strict=True))
            total += float(np.linalg.slogdet(block)[1].sum())
            inverse = np.linalg.inv(block)
            vy[index] = np.einsum("mij,mj->mi", inverse, y[index])
            vx[index] = np.einsum("mij,mjk->mik", inverse, basis[index])
        middle = basis.T @ vx
        projected = basis.T @ vy
        return total + float(np.linalg.slogdet(middle)[1] + y @ vy - projected @ np.linalg.solve(middle, projected))

    def times(self, part: list[FloatArray], x: FloatArray) -> FloatArray:
        """X V for one component, along the last axis."""
        result = np.empty_like(x)
        for index, block in zip(self.index, part, strict=True):
            result[..., index] = (x[..., index][..., None, :] @ block)[..., 0, :] if x.ndim == 1 else self._right(x[:, index], block)
        return result

    @staticmethod
    def _right(x: FloatArray, block: FloatArray) -> FloatArray:
        """X (n, m, b) times block (m, b, b) for each m."""
        result: FloatArray = np.moveaxis(np.moveaxis(x, 1, 0) @ block, 0, 1)
        return result

    def score(self, p: FloatArray, y: FloatArray, parts: list[list[FloatArray]]) -> tuple[FloatArray, FloatArray]:
        """Gradient and information of twice the restricted log likelihood in each of `parts`."""
        py = p @ y
        pv = [self.times(part, p) for part in parts]
        gradient = np.array([py @ self.times(part, py) - np.trace(m) for part, m in zip(parts, pv, strict=True)])
        information = np.array([[np.sum(a * b.T) for b in pv] for a in pv])
        return gradient, information


def estimate(data: Observations, log_lift: FloatArray, columns: FloatArray, slope: FloatArray) -> tuple[Noise, FloatArray]:
    """Variance components and the log lift with outliers pulled in.

    Parameters
    ----------
    data : Observations
    log_lift : (n,)
        Log lift less the base model's prediction.
    columns : (n, k)
        Levels, model Jacobian, families and library side by side; any rank.
    slope : (n,)
        d log ratio / dz per metre, which carries a visit's height error.

    Returns
    -------
    Noise, (n,) array
    """
    basis = orthonormal(columns)
    dof = data.n - basis.shape[1]
    y = log_lift
    relative2 = max(float(np.sum((y - basis @ (basis.T @ y)) ** 2)) / max(dof, 1), 1e-14)
    # every component in units of a relative variance of a typical trial, so that one tolerance serves all
    typical_N = float(np.median(data.lift_N))
    typical_slope = float(np.sqrt(np.mean(slope**2)))
    lever = slope / typical_slope if typical_slope > 0 else slope
    steep = np.abs(lever) > 1e-3
    # a height error of a visit shows only where distances are visited again, by several trials each
    stations = np.unique(np.stack([data.z_hat, data.visit]), axis=1)[0]
    joint = bool(len(np.unique(data.visit[steep])) < steep.sum() and len(stations) - len(np.unique(stations)) >= ENOUGH)
    own = np.maximum((data.u_lift_N / data.lift_N) ** 2, 1e-14)
    index = visits_by_size(data.visit)
    diagonal = [np.eye(i.shape[1]) for i in index]
    parts = [
        [np.broadcast_to(d, (len(i), *d.shape)) for i, d in zip(index, diagonal, strict=True)],
        [((typical_N / data.lift_N) ** 2)[i][:, :, None] * d for i, d in zip(index, diagonal, strict=True)],
    ]
    sizes = relative2 * np.array([0.7, 0.2])
    if joint:
        parts.append([lever[i][:, :, None] * lever[i][:, None, :] for i in index])
        sizes = relative2 * np.array([0.7, 0.2, 0.1])
    model = _Components(index=index, own=own, parts=parts)
    sizes = _maximise(model, y, basis, sizes)
    y = _pull_in(y, basis, own + _diagonal(model, sizes))
    sizes = _maximise(model, y, basis, sizes)
    length, serial = 1.0, _serial_lengths(model, y, basis, sizes)
    if serial:
        fits = []
        for candidate in serial:
            wider = _Components(index=index, own=own, parts=[*parts, _serial_part(model, candidate)])
            trial = _maximise(wider, y, basis, np.append(sizes, 0.3 * sizes.sum()))
            fits.append((wider.deviance(basis, y, trial), candidate, trial))
        _, length, sizes = min(fits, key=lambda f: f[0])
        model = _Components(index=index, own=own, parts=[*parts, _serial_part(model, length)])
    sizes = _not_quite_zero(model, y, basis, sizes)
    found = np.sqrt(sizes)
    noise = Noise(
        relative=float(found[0]),
        force_N=float(found[1]) * typical_N,
        height_m=float(found[2]) / typical_slope if joint else 0.0,
        serial=float(found[-1]) if serial else 0.0,
        serial_length=length,
        source=f"trials orthogonal to every family and effect ({dof} degrees of freedom)",
        dof=float(dof),
    )
    return noise, y


def orthonormal(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns' span, rank found by pivoting; (n, rank)."""
    from scipy.linalg import qr

    length = np.linalg.norm(columns, axis=0)
    x = columns[:, length > 1e-12 * max(length.max(initial=0.0), 1e-300)]
    if not x.shape[1]:
        return np.zeros((len(columns), 0))
    x = x / np.linalg.norm(x, axis=0)
    q, r, _ = qr(x, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    rank = int((diagonal > 1e-8 * diagonal[0]).sum())
    result: FloatArray = q[:, :rank]
    return result


def _diagonal(model: _Components, sizes: FloatArray) -> FloatArray:
    total = np.zeros(len(model.own))
    for size, part in zip(sizes, model.parts, strict=True):
        for index, block in zip(model.index, part, strict=True):
            total[index] += size * np.diagonal(block, axis1=1, axis2=2)
    return total


def _maximise(model: _Components, y: FloatArray, basis: FloatArray, sizes: FloatArray) -> FloatArray:
    """Fisher scoring from `sizes`, each component kept at or above zero."""
    scale = sizes.sum()
    for _ in range(12):
        gradient, information = model.score(model.projector(basis, sizes), y, model.parts)
        new = sizes.copy()
        # one at zero whose gradient points further down stays there
        free = [i for i in range(len(sizes)) if sizes[i] > 0 or gradient[i] > 0]
        while free:
            step = np.linalg.lstsq(information[np.ix_(free, free)], gradient[free], rcond=None)[0]
            trial = sizes[free] + step
            if (trial >= 0).all():
                new[free] = trial
                break
            worst = free[int(np.argmin(trial / np.maximum(sizes[free], 1e-300)))]
            new[worst] = 0.0
            free.remove(worst)
        if not new.any():
            new[0] = sizes[0] / 10
        done = np.allclose(new, sizes, rtol=1e-2, atol=1e-3 * scale)
        sizes = new
        if done:
            break
    return sizes


def _not_quite_zero(model: _Components, y: FloatArray, basis: FloatArray, sizes: FloatArray) -> FloatArray:
    """Variances of which those estimated as zero are set to half a standard error: that is all that is known of them.

    At zero the trials to which such a component matters most would be taken for more precise than they are.
    """
    _, information = model.score(model.projector(basis, sizes), y, model.parts)
    error = np.sqrt(2 * np.maximum(np.diag(np.linalg.pinv(information)), 0))
    return np.where(sizes > 0, sizes, 0.5 * error)


def _serial_part(model: _Components, length: float) -> list[FloatArray]:
    return [np.broadcast_to(serial_block(i.shape[1], length), (len(i), i.shape[1], i.shape[1])) for i in model.index]


def _serial_lengths(model: _Components, y: FloatArray, basis: FloatArray, sizes: FloatArray) -> tuple[float, ...]:
    """The lengths over which neighbours may share noise; empty unless a score test leaves no doubt that they do."""
    longest = max(i.shape[1] for i in model.index)
    lengths = tuple(s for s in SERIAL_LENGTHS if s < longest)
    p = model.projector(basis, sizes)
    for length in lengths:
        gradient, information = model.score(p, y, [_serial_part(model, length), *model.parts])
        # what the present components already explain of it does not count
        rest = information[0, 0] - information[0, 1:] @ np.linalg.lstsq(information[1:, 1:], information[1:, 0], rcond=None)[0]
        if gradient[0] / np.sqrt(2 * max(rest, 1e-300)) > BEYOND_DOUBT:
            return lengths
    return ()


def _pull_in(y: FloatArray, basis: FloatArray, variance: FloatArray) -> FloatArray:
    """The data with residuals beyond `CLIP` standard deviations moved to it."""
    sd = np.sqrt(variance)
    q, _ = np.linalg.qr(basis / sd[:, None])
    white = y / sd
    residual = white - q @ (q.T @ white)
    spread = np.sqrt(np.maximum(1 - np.sum(q**2, axis=1), 0.05))
    robust = 1.4826 * np.median(np.abs(residual / spread))
    limit = CLIP * max(robust, 1e-12) * spread
    moved: FloatArray = y - sd * (residual - np.clip(residual, -limit, limit)) / spread**2
    return moved


def floor(data: Observations, noise: Noise, slope: FloatArray) -> float:
    """Root mean square over trials of the relative scatter that no model could remove."""
    covariance = trial_covariance(data, noise, slope)
    return float(np.sqrt(np.mean(covariance.variance + covariance.per_visit**2 + noise.serial**2)))
