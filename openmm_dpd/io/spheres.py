"""Spheres drawn with light, shadow and depth, as an array of pixels: numpy and scipy alone."""

import numpy as np

#: Pixels of the drawing along one of the picture: their mean is one of its own, so that edges are smooth.
_FINER = 2
#: Towards the light, by the right, the top and the viewer; and the parts of the light that come from everywhere and are reflected.
_LIGHT, _AMBIENT, _SHINE = np.array([-0.45, 0.65, 0.61]), 0.5, 0.18
#: How much darker a shadow is, and how far what is far away fades into the background.
_SHADOW, _FADED = 0.3, 0.3
#: Spheres that are drawn at once: so many pixels.
_CHUNK = 4_000_000


def camera(theta: float, phi: float) -> np.ndarray:
    """(3, 3): unit vectors to the right, to the top and to a viewer in the direction of these polar angles, in degrees; z points up."""
    polar, azimuth = np.radians([theta, phi])
    toward = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(toward, right), toward])


def drawn(
    centres: np.ndarray,
    radii: np.ndarray,
    colours: np.ndarray,
    axes: np.ndarray,
    pixels: int,
    frame: tuple[tuple[int, int], np.ndarray, float] | None = None,
) -> np.ndarray:
    """Draw spheres in a parallel projection.

    Parameters
    ----------
    centres : (N, 3) array
        Of at least one sphere.
    radii : (N,) array
    colours : (N, 3) array
        Red, green and blue from 0 to 1.
    axes : (3, 3) array
        Right, top and viewer, see :func:`camera`.
    pixels : int
        Longer side of the picture.
    frame : tuple, optional
        Width and height of the picture in pixels, the point in its middle, and how high it is in units of the radii.

    Returns
    -------
    (H, W, 4) array
        Red, green, blue and opacity from 0 to 1, the top row first.
    """
    from scipy.ndimage import gaussian_filter

    seen = centres @ axes.T
    low, high = (seen[:, :2] - radii[:, None]).min(0), (seen[:, :2] + radii[:, None]).max(0)
    scale = _FINER * pixels / max(float((high - low).max()), 1e-12)
    shape = tuple(_FINER * np.maximum(np.ceil((high - low)[::-1] * scale / _FINER).astype(int), 1))
    if frame is not None:
        (width, height), middle, high_is = frame
        scale, shape = _FINER * height / high_is, (_FINER * height, _FINER * width)
        low = axes[:2] @ middle - 0.5 * _FINER * np.array([width, height]) / scale
    depth, front = _nearest(seen, radii, low, scale, shape)
    rows, columns = np.nonzero(front >= 0)
    its, found = front[rows, columns], depth[rows, columns]
    points = np.column_stack([low[0] + (columns + 0.5) / scale, low[1] + (rows + 0.5) / scale, found])
    normals = (points - seen[its]) / radii[its, None]
    light = _LIGHT / np.linalg.norm(_LIGHT)
    lit = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normals @ light, 0.0, 1.0)
    dark = np.zeros(shape)
    dark[rows, columns] = _shadowed(seen, radii, points, light, scale)
    lit *= 1.0 - _SHADOW * gaussian_filter(dark, _FINER)[rows, columns]
    half = light + [0.0, 0.0, 1.0]
    shine = _SHINE * np.clip(normals @ (half / np.linalg.norm(half)), 0.0, 1.0) ** 30
    far = (seen[its, 2].max() - seen[its, 2]) / max(float(np.ptp(seen[:, 2])), 1e-12)
    colour = colours[its] * lit[:, None] + shine[:, None]
    picture = np.zeros((*shape, 4))
    picture[rows, columns, :3] = np.clip(colour + _FADED * far[:, None] * (1.0 - colour), 0.0, 1.0)
    picture[rows, columns, 3] = 1.0
    mean = picture.reshape(shape[0] // _FINER, _FINER, shape[1] // _FINER, _FINER, 4).mean((1, 3))
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-12)
    return mean[::-1]


def _nearest(seen: np.ndarray, radii: np.ndarray, low: np.ndarray, scale: float, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) depth of what is in front in each pixel, and which sphere that is, -1 for none."""
    depth, front = np.full(shape[0] * shape[1], -np.inf), np.full(shape[0] * shape[1], -1)
    for radius in np.unique(radii):
        half = int(np.ceil(radius * scale)) + 1
        across, up = (grid.ravel() for grid in np.meshgrid(*[np.arange(-half, half + 1)] * 2))
        inside = across**2 + up**2 <= (radius * scale + 1.0) ** 2
        across, up = across[inside], up[inside]
        alike = np.flatnonzero(radii == radius)
        for part in np.array_split(alike, len(alike) * len(across) // _CHUNK + 1):
            place = (seen[part, :2] - low) * scale
            column, row = np.floor(place).astype(int).T
            columns, rows = column[:, None] + across, row[:, None] + up
            left = radius**2 - ((columns + 0.5 - place[:, :1]) ** 2 + (rows + 0.5 - place[:, 1:]) ** 2) / scale**2
            there = (left >= 0.0) & (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            pixel, owner = (rows * shape[1] + columns)[there], np.broadcast_to(part[:, None], there.shape)[there]
            its = seen[owner, 2] + np.sqrt(left[there])
            np.maximum.at(depth, pixel, its)
            won = its >= depth[pixel]
            front[pixel[won]] = owner[won]
    return depth.reshape(shape), front.reshape(shape)


def _shadowed(seen: np.ndarray, radii: np.ndarray, points: np.ndarray, light: np.ndarray, scale: float) -> np.ndarray:
    """Whether each point lies in the shadow of a sphere."""
    right = np.cross([0.0, 1.0, 0.0], light)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(light, right), light])
    turned, at = seen @ axes.T, points @ axes.T
    low, high = (turned[:, :2] - radii[:, None]).min(0), (turned[:, :2] + radii[:, None]).max(0)
    shape = tuple(((high - low)[::-1] * scale).astype(int) + 1)
    depth, _ = _nearest(turned, radii, low, scale, shape)
    column, row = np.clip(((at[:, :2] - low) * scale).astype(int), 0, np.array(shape[::-1]) - 1).T
    return depth[row, column] > at[:, 2] + 2.0 / scale + 0.02 * radii.max()
