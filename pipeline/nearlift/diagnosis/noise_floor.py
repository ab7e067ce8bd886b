"""The scatter of trials about anything smooth: variance components orthogonal to every family and every library effect.

Taken from raw scatter within cells, a drift or a sagging supply would be booked as noise and then hide behind it. So the
components are estimated by restricted maximum likelihood in what is left after all flexible columns together, by Fisher
scoring, with outlying trials pulled in to 3.5 standard deviations. Noise that neighbours within a visit have in common is added
where it shows itself beyond doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fitting.covariance import serial_block, visits_by_size
from nearlift.fitting.noise import ENOUGH, trial_covariance
from nearlift.results import IntArray, Noise, Observations

CLIP = 3.5
#: Noise shared by neighbours is looked for over these numbers of trials, and believed beyond so many standard errors.
SERIAL_LENGTHS = (1.0, 3.0, 10.0, 30.0)
BEYOND_DOUBT = 3.5
#: Trials whose part of a score is worked out at once.
AT_ONCE = 2000
#: No component grows beyond this many times what scoring began with.
LARGEST = 1e3


@dataclass(frozen=True, kw_only=True)
class _Components:
    """Variance components as blocks by visit: `own` fixed, each of `parts` a list of (m, b, b) matching `index`.

    The restricted likelihood's P = V^-1 - U U' has a V^-1 of blocks and few columns U (n, k), so nothing n x n is ever formed.
    """

    index: list[IntArray]
    own: FloatArray
    parts: list[list[FloatArray]]

    def _precision(self, sizes: FloatArray) -> tuple[list[FloatArray], float]:
        """V^-1 by visit, and log det V."""
        inverse, log_det = [], 0.0
        for i, index in enumerate(self.index):
            block = self.own[index][:, :, None] * np.eye(index.shape[1]) + sum(s * part[i] for s, part in zip(sizes, self.parts, strict=True))
            inverse.append(np.linalg.inv(block))
            log_det += float(np.linalg.slogdet(block)[1].sum())
        return inverse, log_det

    def _times(self, blocks: list[FloatArray], x: FloatArray) -> FloatArray:
        """Blocks times x (n,) or (n, k)."""
        result = np.empty_like(x)
        for index, block in zip(self.index, blocks, strict=True):
            result[index] = block @ x[index] if x.ndim == 2 else (block @ x[index][:, :, None])[:, :, 0]
        return result

    def projector(self, basis: FloatArray, sizes: FloatArray) -> tuple[list[FloatArray], FloatArray, float]:
        """V^-1 by visit and U of P = V^-1 - U U' that removes `basis` (n, k); log det V + log det X' V^-1 X."""
        from scipy.linalg import solve_triangular

        inverse, log_det = self._precision(sizes)
        vx = self._times(inverse, basis)
        try:
            triangle = np.linalg.cholesky(basis.T @ vx)
        except np.linalg.LinAlgError as fault:
            what = (
                f"the variances of trials differ by a factor of {self.own.max() / self.own.min():.0e} and more: beside some, others count for nothing"
            )
            raise NotConverged("noise floor", what, "look for lifts in another unit, near zero, or with a wrong standard error") from fault
        u: FloatArray = solve_triangular(triangle, vx.T, lower=True, check_finite=False).T
        return inverse, u, log_det + 2 * float(np.log(np.diag(triangle)).sum())

    def deviance(self, basis: FloatArray, y: FloatArray, sizes: FloatArray) -> float:
        """Minus twice the restricted log likelihood, up to a constant."""
        inverse, u, log_det = self.projector(basis, sizes)
        return log_det + float(y @ self._times(inverse, y) - np.sum((u.T @ y) ** 2))

    def score(self, basis: FloatArray, y: FloatArray, sizes: FloatArray, further: Sequence[list[FloatArray]] = ()) -> tuple[FloatArray, FloatArray]:
        """Gradient and information of twice the restricted log likelihood in each component, those of `further` (not in V) last.

        With A' = V^-1 A for a component A: tr(P A P B) = tr(A' B') - 2 tr(U' A V^-1 B U) + tr(U' A U U' B U).
        """
        parts = [*self.parts, *further]
        inverse, u, _ = self.projector(basis, sizes)
        py = self._times(inverse, y) - u @ (u.T @ y)
        count, k = len(parts), u.shape[1]
        traces, information, uau = np.zeros(count), np.zeros((count, count)), np.zeros((count, k, k))
        for index, whole, *own in zip(self.index, inverse, *parts, strict=True):
            # some visits at a time: U is as large as anything here, and every product with it as large again
            at_once = max(AT_ONCE // index.shape[1], 1)
            for first in range(0, len(index), at_once):
                some = slice(first, first + at_once)
                here, w = u[index[some]], whole[some]
                scaled, of_u = [w @ a[some] for a in own], [a[some] @ here for a in own]
                for j, of_one in enumerate(of_u):
                    traces[j] += float(np.trace(scaled[j], axis1=1, axis2=2).sum())
                    uau[j] += here.reshape(-1, k).T @ of_one.reshape(-1, k)
                    weighed = w @ of_one
                    for i in range(j, count):
                        blocks = float(np.sum(scaled[i] * scaled[j].swapaxes(1, 2)))
                        information[i, j] += blocks - 2 * float(np.vdot(of_u[i], weighed))
        gradient = np.array([py @ self._times(a, py) - t + float(np.trace(x)) for a, t, x in zip(parts, traces, uau, strict=True)])
        for j in range(count):
            for i in range(j, count):
                information[i, j] = information[j, i] = information[i, j] + float(np.vdot(uau[i], uau[j]))
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
    # as large as all that follows, and done with
    del columns
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

    length = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    kept = length > 1e-12 * max(length.max(initial=0.0), 1e-300)
    if not kept.any():
        return np.zeros((len(columns), 0))
    # one copy, laid out so that the factorisation works in its place
    x = np.array(columns[:, kept], order="F", copy=None)
    np.divide(x, [float(np.sqrt(np.sum(column**2))) for column in x.T], out=x)
    q, r, _ = qr(x, mode="economic", pivoting=True, check_finite=False, overwrite_a=True)
    diagonal = np.abs(np.diag(r))
    rank = int((diagonal > 1e-8 * diagonal[0]).sum())
    return np.asarray(q[:, :rank], dtype=np.float64)


def _diagonal(model: _Components, sizes: FloatArray) -> FloatArray:
    total = np.zeros(len(model.own))
    for size, part in zip(sizes, model.parts, strict=True):
        for index, block in zip(model.index, part, strict=True):
            total[index] += size * np.diagonal(block, axis1=1, axis2=2)
    return total


def _maximise(model: _Components, y: FloatArray, basis: FloatArray, sizes: FloatArray) -> FloatArray:
    """Fisher scoring from `sizes`, each component kept at or above zero."""
    scale = sizes.sum()
    # with little freedom left the information is next to nothing, and a step by it would know no end
    most = LARGEST * scale
    for _ in range(12):
        gradient, information = model.score(basis, y, sizes)
        new = sizes.copy()
        # one at zero whose gradient points further down stays there
        free = [i for i in range(len(sizes)) if sizes[i] > 0 or gradient[i] > 0]
        while free:
            step = np.linalg.lstsq(information[np.ix_(free, free)], gradient[free], rcond=None)[0]
            trial = sizes[free] + step
            if (trial >= 0).all():
                new[free] = np.minimum(trial, most)
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
    """Variances of which those estimated as zero are set to half a standard error of theirs.

    A variance is not negative, so scoring puts it at zero in about half of all campaigns that have little of it, and zero is then the
    lower end of what the data allow and no estimate. Which components there are changes from trial to trial (force noise grows as lift falls,
    height noise as the curve steepens): at zero, the trials to which one matters most would be taken for more precise than they are, and tests
    of structure would lean on just those. What a normal likelihood that peaks at zero leaves of a positive variance has its mode at 0 and its
    median at 0.67 standard errors; half of one lies between. With much data the standard error, and so the stand-in, goes to zero.
    """
    _, information = model.score(basis, y, sizes)
    error = np.sqrt(2 * np.maximum(np.diag(np.linalg.pinv(information)), 0))
    return np.where(sizes > 0, sizes, 0.5 * error)


def _serial_part(model: _Components, length: float) -> list[FloatArray]:
    return [np.broadcast_to(serial_block(i.shape[1], length), (len(i), i.shape[1], i.shape[1])) for i in model.index]


def _serial_lengths(model: _Components, y: FloatArray, basis: FloatArray, sizes: FloatArray) -> tuple[float, ...]:
    """The lengths over which neighbours may share noise; empty unless a score test leaves no doubt that they do."""
    longest = max(i.shape[1] for i in model.index)
    lengths = tuple(s for s in SERIAL_LENGTHS if s < longest)
    gradient, information = model.score(basis, y, sizes, [_serial_part(model, length) for length in lengths])
    present = len(model.parts)
    for i in range(present, present + len(lengths)):
        # what the present components already explain of it does not count
        own = np.linalg.lstsq(information[:present, :present], information[:present, i], rcond=None)[0]
        rest = information[i, i] - information[i, :present] @ own
        if gradient[i] / np.sqrt(2 * max(rest, 1e-300)) > BEYOND_DOUBT:
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
