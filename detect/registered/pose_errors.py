"""What is left in the flow by errors of the poses."""

import numpy as np

from geometry.arrays import FloatArray, FloatMap

TERMS = 9
"""Of `_error_terms`."""
STRIDE = 4
"""Every so many rows and columns enter the fit of a pose error; fewer fit it visibly worse."""
SOME = slice(STRIDE // 2, None, STRIDE)
"""Those rows, or columns."""
FITS = 4
"""Fits with weights by the misfits of the one before."""
LEAST_WEIGHT = 0.1
"""Weight of a pixel from which on it counts among those that give the scale of misfits."""
FEWEST_PIXELS = 10 * TERMS
"""Such pixels, at least, that an error is fitted to."""
STIFFNESS = 1e-3
"""Keeps terms at zero that the pixels do not show, in units of their summed weights."""
OUTLYING, LEAST_SCALE_PX = 1.8, 0.015
"""Misfit from which on a pixel is an outlier, over the median misfit; and at least, px."""


class PoseErrors:
    """What small errors of a pose look like in a scene of (H, W) inverse depths, in any unit.

    A turn of the camera moves pixels by a quadratic in their position, a shift by inverse depth
    times a linear function (Longuet-Higgins & Prazdny, Proc. R. Soc. B 1980, eq. 2.11 and 2.12).
    """

    def __init__(self, inverse_depth: FloatMap) -> None:
        self._inverse_depth = inverse_depth
        y, x = (np.linspace(-0.5, 0.5, n, dtype=np.float32) for n in inverse_depth.shape)
        self._x, self._y = x, y[:, None]
        some = _error_terms(x[SOME], y[SOME, None], inverse_depth[SOME, SOME])
        self._terms = some.reshape(TERMS, -1).astype(float)

    def fit(self, field: FloatMap, weights: FloatMap) -> FloatMap:
        """The error that explains a field best, by robust least squares.

        Args:
            field: (2, h, w) px, `SOME` of the rows and columns.
            weights: (h, w) from 0 to 1.

        Returns:
            (2, 9) for `field`; zero where too little of the image has weight.
        """
        values = field.reshape(2, -1).astype(float)
        prior = weights.ravel().astype(float)
        weighted = prior > LEAST_WEIGHT
        if weighted.sum() < FEWEST_PIXELS:
            return np.zeros((2, TERMS), np.float32)
        coefficients, robust = np.zeros((2, TERMS)), prior
        for _ in range(FITS):
            coefficients = self._solve_terms(values, robust)
            misfit = values - coefficients @ self._terms
            squares = (misfit * misfit).sum(axis=0)
            robust = prior / (1 + squares / _squared_scale(squares[weighted]))
        return coefficients.astype(np.float32)

    def _solve_terms(self, values: FloatArray, weights: FloatArray) -> FloatArray:
        products = self._terms * weights
        normal = products @ self._terms.T + STIFFNESS * np.eye(len(products))
        return np.asarray(np.linalg.solve(normal, products @ values.T).T)

    def error_fields(self, coefficients: FloatMap, rows: slice) -> FloatMap:
        """(..., h, W) px, some rows of the errors, (..., 9), that `fit` found."""
        terms = _error_terms(self._x, self._y[rows], self._inverse_depth[rows])
        planes = coefficients.reshape(-1, TERMS) @ terms.reshape(TERMS, -1)
        return np.asarray(planes.reshape(*coefficients.shape[:-1], *terms.shape[1:]))


def _error_terms(x: FloatMap, y: FloatMap, inverse_depth: FloatMap) -> FloatMap:
    """(9, h, w) what an error is made of; x and y go with inverse depth by broadcasting."""
    terms = np.empty((TERMS, *inverse_depth.shape), np.float32)
    for k, term in enumerate((1, x, y, x * x, y * y, x * y)):
        terms[k] = term
    np.multiply(inverse_depth, terms[:3], out=terms[6:])
    return terms


def _squared_scale(squares: FloatArray) -> float:
    """The squared misfit at which a pixel counts half, px squared."""
    return max(OUTLYING * float(np.sqrt(np.median(squares))), LEAST_SCALE_PX) ** 2
