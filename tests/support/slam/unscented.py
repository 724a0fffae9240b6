"""The unscented transform in its plain form, which the kernels are held to."""

from collections.abc import Callable

import numpy as np

from drivers.measurements import FloatArray
from slam.settings.sigma_points import unscented_weights
from slam.unscented import square_root_into


def unscented_transform(
    mean: FloatArray,
    covariance: FloatArray,
    function: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (m,), covariance (m, m) and cross covariance (n, m) of function(x) for x ~ N(mean (n,), covariance (n, n)).

    For vectors without angles.
    """
    weights = unscented_weights(mean.size)
    columns = weights.scale * square_root(covariance)
    points = np.vstack((mean, mean + columns.T, mean - columns.T))
    images = np.array([function(point) for point in points])
    mean_weights = np.full(len(points), weights.other)
    covariance_weights = mean_weights.copy()
    mean_weights[0], covariance_weights[0] = weights.mean_centre, weights.covariance_centre
    image_mean = mean_weights @ images
    deviations = images - image_mean
    return (
        image_mean,
        (covariance_weights * deviations.T) @ deviations,
        (covariance_weights * (points - mean).T) @ deviations,
    )


def square_root(covariance: FloatArray) -> FloatArray:
    """Lower triangular L (n, n) with L L^T = covariance, as square_root_into makes it."""
    root = np.zeros(covariance.shape)
    square_root_into(covariance, root)
    return root
