"""Scenes and formulas with known answers."""

import mrvis
import numpy as np

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
UP = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
DOWN = UP[:, ::-1]


def squares(height=1.0, emission=10.0, reflectance=0.0):
    """Two unit squares that face each other, `height` apart; the upper one emits."""
    builder = mrvis.SceneBuilder()
    grey = builder.add_material("grey", [reflectance] * 3)
    light = builder.add_material("light", [0, 0, 0], [emission] * 3)
    builder.add_object("floor", SQUARE, UP, material=grey)
    builder.add_object("lamp", SQUARE + [0, 0, height], DOWN, material=light)
    return builder.finish()


def opposite(a, b, c):
    """Form factor from a point to a parallel rectangle a x b at the distance c, one corner of which is above the point."""
    x, y = a / c, b / c
    p, q = np.hypot(1, x), np.hypot(1, y)
    return (x / p * np.arctan(y / p) + y / q * np.arctan(x / q)) / (2 * np.pi)
