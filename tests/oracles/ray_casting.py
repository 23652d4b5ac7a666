"""Slow reference for ray casting: one ray and one surface at a time, in double precision.

Segments are pairs of end points, circles `x, y, radius`, poses `x, y, theta`; metres and radians.
"""

import cmath
import math


def ranges(segments, circles, pose, bearings):
    """Distances from the pose to the nearest surface along `bearings`; infinite if none is met."""
    return [_range(segments, circles, pose, bearing) for bearing in bearings]


def _range(segments, circles, pose, bearing):
    x, y, theta = (float(value) for value in pose)
    turn = cmath.exp(-1j * (theta + float(bearing)))

    def on_ray(point):
        """The point as along + i * across, the ray being the positive real axis."""
        return (complex(*(float(value) for value in point)) - complex(x, y)) * turn

    met = [math.inf]
    for start, end in segments:
        met += _segment(on_ray(start), on_ray(end))
    for *centre, radius in circles:
        met += _circle(on_ray(centre), float(radius))
    return min(distance for distance in met if distance > 0)


def _segment(start, end):
    """Where the segment meets the real axis."""
    if start == end:
        return []
    if start.imag == end.imag:  # parallel to the ray: met only if it lies on it, at either end
        return [start.real, end.real] if start.imag == 0 else []
    share = start.imag / (start.imag - end.imag)
    return [(start + share * (end - start)).real] if 0 <= share <= 1 else []


def _circle(centre, radius):
    """Where the circle meets the real axis."""
    if radius <= 0 or abs(centre.imag) >= radius:
        return []
    half_chord = math.sqrt(radius**2 - centre.imag**2)
    return [centre.real - half_chord, centre.real + half_chord]
