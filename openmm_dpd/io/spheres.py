"""Spheres drawn with light, shadow and depth, as an array of pixels."""

import numpy as np

from ..runtime import compiled

#: Pixels of the drawing along one of the picture: their mean is one of its own, so that edges are smooth.
_FINER = 2
#: Towards the light, by the right, the top and the viewer; and the parts of the light that come from everywhere and are reflected.
_LIGHT, _AMBIENT, _SHINE = np.array([-0.45, 0.65, 0.61]), 0.5, 0.18
#: How much darker a shadow is, and how far what is far away fades into the background.
_SHADOW, _FADED = 0.3, 0.3


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
    (H, W, 4) array of float32
        Red, green, blue and opacity from 0 to 1, the top row first.
    """
    from PIL import Image, ImageFilter  # comes with matplotlib, and takes a tenth of the time that scipy's module takes to import

    seen = centres @ axes.T
    low, high = (seen[:, :2] - radii[:, None]).min(0), (seen[:, :2] + radii[:, None]).max(0)
    scale = _FINER * pixels / max(float((high - low).max()), 1e-12)
    shape = tuple(_FINER * np.maximum(np.ceil((high - low)[::-1] * scale / _FINER).astype(int), 1))
    if frame is not None:
        (width, height), middle, high_is = frame
        scale, shape = _FINER * height / high_is, (_FINER * height, _FINER * width)
        low = axes[:2] @ middle - 0.5 * _FINER * np.array([width, height]) / scale
    depth, front = _nearest(seen, radii, low, scale, shape)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    dark = np.zeros(shape, np.uint8)
    _shadow(depth, low, scale, *_seen_by(light, seen, radii, scale), 2.0 / scale + 0.02 * radii.max(), dark)
    blurred = np.asarray(Image.fromarray(dark).filter(ImageFilter.GaussianBlur(_FINER)))
    half = light + [0.0, 0.0, 1.0]
    shown = np.zeros(len(seen) + 1, bool)
    shown[front] = True  # the last one is for pixels with nothing
    picture = np.zeros((shape[0] // _FINER, shape[1] // _FINER, 4), np.float32)
    _shade(
        depth, front, blurred, seen, radii, np.ascontiguousarray(colours, dtype=float), low, scale, light,
        half / np.linalg.norm(half), seen[shown[:-1], 2].max(initial=-np.inf), max(float(np.ptp(seen[:, 2])), 1e-12), picture,
    )  # fmt: skip
    return picture[::-1]


def _nearest(seen: np.ndarray, radii: np.ndarray, low: np.ndarray, scale: float, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) depth of what is in front in each pixel, and which sphere that is, -1 for none."""
    depth, front = np.full(shape, -np.inf, np.float32), np.full(shape, -1, np.int32)
    _cover(np.ascontiguousarray(seen), np.ascontiguousarray(radii, dtype=float), low, scale, depth, front)
    return depth, front


def _seen_by(light: np.ndarray, seen: np.ndarray, radii: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes, lower corner and depths of the spheres seen along the light."""
    right = np.cross([0.0, 1.0, 0.0], light)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(light, right), light])
    turned = seen @ axes.T
    low, high = (turned[:, :2] - radii[:, None]).min(0), (turned[:, :2] + radii[:, None]).max(0)
    width, height = ((high - low) * scale).astype(int) + 1
    return axes, low, _nearest(turned, radii, low, scale, (height, width))[0]


@compiled
def _cover(seen, radii, low, scale, depth, front):
    """Draw spheres into the depths of what is in front, and their numbers."""
    rows, columns = depth.shape
    for k in range(len(seen)):
        x, y, r = (seen[k, 0] - low[0]) * scale, (seen[k, 1] - low[1]) * scale, radii[k] * scale
        for row in range(max(0, int(np.floor(y - r))), min(rows, int(np.floor(y + r)) + 1)):
            for column in range(max(0, int(np.floor(x - r))), min(columns, int(np.floor(x + r)) + 1)):
                left = r * r - (column + 0.5 - x) ** 2 - (row + 0.5 - y) ** 2
                if left >= 0.0:
                    z = seen[k, 2] + np.sqrt(left) / scale
                    if z >= depth[row, column]:
                        depth[row, column], front[row, column] = z, k


@compiled
def _shadow(depth, low, scale, axes, light_low, lit, margin, dark):
    """Set what is in front and behind something else on the way to the light to 255 in ``dark``."""
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] > -np.inf:
                x, y, z = low[0] + (column + 0.5) / scale, low[1] + (row + 0.5) / scale, depth[row, column]
                across = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
                up = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
                i = min(max(int((up - light_low[1]) * scale), 0), lit.shape[0] - 1)
                j = min(max(int((across - light_low[0]) * scale), 0), lit.shape[1] - 1)
                if lit[i, j] > axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z + margin:
                    dark[row, column] = 255


@compiled
def _shade(depth, front, dark, seen, radii, colours, low, scale, light, half, nearest, deep, picture):
    """Write the colours and opacities of the picture, whose pixels are means of several of ``front``."""
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            k = front[row, column]
            if k >= 0:
                x = (low[0] + (column + 0.5) / scale - seen[k, 0]) / radii[k]
                y = (low[1] + (row + 0.5) / scale - seen[k, 1]) / radii[k]
                z = (depth[row, column] - seen[k, 2]) / radii[k]
                lit = _AMBIENT + (1.0 - _AMBIENT) * max(x * light[0] + y * light[1] + z * light[2], 0.0)
                lit *= 1.0 - _SHADOW / 255.0 * dark[row, column]
                shine = _SHINE * max(x * half[0] + y * half[1] + z * half[2], 0.0) ** 30
                faded = _FADED * (nearest - seen[k, 2]) / deep
                pixel = picture[row // _FINER, column // _FINER]
                for c in range(3):
                    colour = colours[k, c] * lit + shine
                    pixel[c] += min(max(colour + faded * (1.0 - colour), 0.0), 1.0)
                pixel[3] += 1.0
    for row in range(picture.shape[0]):
        for column in range(picture.shape[1]):
            pixel = picture[row, column]
            for c in range(3):
                pixel[c] /= max(pixel[3], 1.0)
            pixel[3] /= _FINER * _FINER
